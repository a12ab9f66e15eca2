"""Training images: hands are rendered; crops are decoded, read from the map, or picked in memory."""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import torch

from hand_recon.data.annotated_dataset import AnnotatedImages, ImageRecipe
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import CropReader, ReadingPolicy
from hand_recon.data.dataset import load_batch
from hand_recon.data.resident import ResidentDataset
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import synthetic_hand
from hand_recon.schema import HandBatch
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.rows import Row

LEVELS: Final = ("easy", "medium", "hard")
SIDES: Final = (64, 128, 224)
"""Sides of rendered images and crops, pixels."""
PHOTOGRAPHS: Final = {"224 × 224 photograph": (224, 224), "640 × 480 photograph": (640, 480)}
"""Sizes of FreiHAND's and DexYCB's photographs, pixels."""
BATCH: Final = 64
WANTED: Final = 10.0
"""Least number of times that a batch from the map is faster."""


def measure(settings: Settings) -> Iterator[Row]:
    """Time rendering and both ways to read a batch of crops."""
    sides = SIDES[:1] if settings.quick else SIDES
    for side in sides:
        yield from _rendering(side, settings)
    with tempfile.TemporaryDirectory() as folder:
        for name, size in PHOTOGRAPHS.items():
            for side in sides:
                yield _reading(Path(folder), name, size, side, settings)
        for side in sides:
            yield _picking(Path(folder), side, settings)


def _picking(folder: Path, side: int, settings: Settings) -> Row:
    """Whole batches with labels, in random order: picked in memory, and read from the map and stacked."""
    name, size = next(iter(PHOTOGRAPHS.items()))
    hands = photographs(folder / f"{size[0]}", size)
    recipe = ImageRecipe(
        CropPolicy(size=side, around="joints"), ReadingPolicy(cache_dir=folder / "cache")
    )
    dataset = AnnotatedImages(hands, None, recipe)
    memory = ResidentDataset(dataset, torch.device("cpu"), "the benchmark")
    picked = partial(_next_batch, memory.batch, len(dataset), count())
    read = partial(_next_batch, partial(load_batch, dataset), len(dataset), count())
    first, second = picked(), read()
    times = interleaved({"memory": picked, "map": read}, settings)
    return Row(
        suite="data",
        work=f"batches from memory, {name}",
        size=f"{BATCH} samples of {side} px",
        items=BATCH,
        seconds=spread(times["memory"]),
        reference="crops from the map, stacked with their labels",
        reference_seconds=spread(times["map"]),
        ratio=ratios(times["map"], times["memory"]),
        difference=f"{int((first.image != second.image).sum())} pixels",
    )


def _next_batch(
    read: Callable[[list[int]], HandBatch], size: int, numbers: Iterator[int]
) -> HandBatch:
    generator = torch.Generator().manual_seed(next(numbers))
    return read(torch.randperm(size, generator=generator)[:BATCH].tolist())


def _rendering(side: int, settings: Settings) -> Iterator[Row]:
    """Rates of the levels of difficulty, one image after another."""
    works: dict[str, Work] = {}
    for level in LEVELS:
        recipe = Recipe("train", level_named(level), side, 0)
        works[level] = partial(_next_image, recipe, count())
    for level, times in interleaved(works, settings).items():
        yield Row(
            suite="data", work=f"rendering, {level}", size=f"{side} px", seconds=spread(times)
        )


def _next_image(recipe: Recipe, indices: Iterator[int]) -> None:
    synthetic_hand(recipe, next(indices))


def _reading(folder: Path, name: str, size: tuple[int, int], side: int, settings: Settings) -> Row:
    """A batch in random order from the map, and from JPEG files that are decoded and cropped."""
    hands, rows = photographs(folder / f"{size[0]}", size), np.arange(2 * BATCH)
    crop = CropPolicy(size=side, around="joints")
    stored = CropReader(hands, rows, crop, ReadingPolicy(cache_dir=folder / "cache"))
    decoded = CropReader(hands, rows, crop, ReadingPolicy())
    batches = np.random.default_rng(0).permuted(np.tile(rows, (64, 1)), axis=1)[:, :BATCH]
    works: dict[str, Work] = {
        "map": partial(read_batch, stored, batches, count()),
        "JPEG": partial(read_batch, decoded, batches, count()),
    }
    pair = [read_batch(reader, batches, count()) for reader in (stored, decoded)]
    times = interleaved(works, settings)
    return Row(
        suite="data",
        work=f"crops from the map, {name}",
        size=f"{BATCH} crops of {side} px",
        items=BATCH,
        seconds=spread(times["map"]),
        reference="JPEG decoded and cropped",
        reference_seconds=spread(times["JPEG"]),
        ratio=ratios(times["JPEG"], times["map"]),
        wanted_ratio=WANTED,
        difference=f"{int((pair[0] != pair[1]).sum())} pixels",
    )


def read_batch(reader: CropReader, batches: np.ndarray, numbers: Iterator[int]) -> np.ndarray:
    """Read the next batch of crops as one array.

    Args:
        reader: Reader of the map or of the files.
        batches: Rows of each batch.
        numbers: Counts the batches, which follow each other round and round.

    Raises:
        RuntimeError: A crop cannot be read.
    """
    rows = batches[next(numbers) % len(batches)]
    crops = [reader.read(int(row)) for row in rows]
    if any(crop is None for crop in crops):
        raise RuntimeError(
            "A photograph of the benchmark cannot be read; expected all to be whole."
        )
    return np.stack([crop.pixels for crop in crops if crop is not None])


def photographs(folder: Path, size: tuple[int, int]) -> AnnotatedHands:
    """Write a rendered hand in front of noise as many JPEG files, unless they are there.

    Args:
        folder: Folder of the files.
        size: Width and height, pixels.
    """
    folder.mkdir(parents=True, exist_ok=True)
    hand = synthetic_hand(Recipe("train", level_named("medium"), 224, 0), 0)
    width, height = size
    random = np.random.default_rng(0)
    paths, landmarks = [], []
    for number in range(2 * BATCH):
        coarse = random.integers(0, 256, size=(height // 8, width // 8, 3), dtype=np.uint8)
        image = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC))
        corner = random.integers(0, (width - 223, height - 223))
        image[corner[1] : corner[1] + 224, corner[0] : corner[0] + 224] = hand.image[..., ::-1]
        paths.append(folder / f"{number:04d}.jpg")
        landmarks.append(hand.landmarks_2d + corner)
        if not paths[-1].is_file():
            cv2.imwrite(str(paths[-1]), image)
    named = f"benchmark-{width}x{height}"
    return AnnotatedHands(named, folder, paths, named, np.stack(landmarks))
