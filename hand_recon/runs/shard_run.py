"""Writes images and their 2D landmarks into shards (`hand-recon prepare shards`, decision 98)."""

import itertools
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from hand_recon import __version__
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits, scenes_of
from hand_recon.data.progress import with_progress
from hand_recon.data.shards.datamodule import ShardDataModule
from hand_recon.data.shards.encoding import Encoding, too_many_bytes
from hand_recon.data.shards.facts import Facts, facts_of, read_facts
from hand_recon.data.shards.index import LARGEST_LABELS
from hand_recon.data.shards.labels import labels_to_json
from hand_recon.data.shards.manifest import MANIFEST, Manifest, Shard
from hand_recon.data.shards.writer import ShardImage, write_shard
from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.runs.configuration import plain
from hand_recon.runs.photo_results import appending, read_progress
from hand_recon.runs.unfinished import claim_or_resume, finish, results_folder, settings_of

logger = logging.getLogger(__name__)

PROGRESS: Final = "progress.jsonl"
"""Shards that the command has finished; it is removed at the end."""

PRODUCTS: Final = (MANIFEST, PROGRESS, "config.yaml", "shard-00000.tar")
"""Files of the command; a folder that holds one of them is not written to."""

GROUPS: Final = ("image", "person")
"""Choices of what stays in one split."""

_AT_ONCE: Final = 64
"""Images that are encoded before the next ones are begun."""

_MAY_CHANGE: Final = ("workers", "max_damaged", "source", "task")
"""Options that may differ when an interrupted command goes on."""


@dataclass(frozen=True)
class _LeftOut:
    """An image that is not written."""

    name: str
    """Path from the folder of the images."""
    reason: str
    """Clause for messages."""


@dataclass(frozen=True)
class _Source:
    """Everything that shards are made of."""

    table: AnnotatedHands
    rows_of_image: Sequence[Sequence[int]]
    groups: np.ndarray
    """Number of each row's group; -1 for rows of no image that is taken."""
    facts: Facts
    encoding: Encoding

    def image(self, number: int) -> "ShardImage | _LeftOut":
        """An image with its labels, or the reason for which it has no place in a shard."""
        rows = self.rows_of_image[number]
        name = self.table.source(rows[0])
        try:
            encoded = self.encoding.read(self.table.images[rows[0]])
        except ValueError as error:
            return _LeftOut(name, str(error))
        labels = labels_to_json(self.table, rows, facts_of(self.facts, name), encoded.scale)
        if len(labels) > LARGEST_LABELS:
            told = too_many_bytes(
                f"the text of its {len(rows)} labels", len(labels), LARGEST_LABELS
            )
            return _LeftOut(name, told)
        groups = self.groups[list(rows)].tolist()
        return ShardImage(number, encoded.suffix, encoded.content, labels, groups)


def prepare_shards(config: DictConfig) -> dict[str, Any]:
    """`prepare shards labels=<file> images=<folder> output=<folder>`: write shards and their manifest.

    Args:
        config: `conf/prepare_shards.yaml` composed.

    Returns:
        Folder and numbers of shards, images and hands, and names of images that cannot be read.

    Raises:
        ValueError: An option is wrong, no hand is left, or too many images cannot be read.
        FileExistsError: The folder holds something else.
    """
    source = _source(config)
    folder = results_folder(config)
    settings = settings_of(config, ("labels", "fields"))
    for key in _MAY_CHANGE:
        settings["options"].pop(key, None)
    settings["data"] = source.table.fingerprint
    claim_or_resume(folder, PRODUCTS, settings)
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    shards, damaged = _write_all(config, source, folder)
    manifest = _manifest(config, source, shards, damaged)
    with replaced_when_whole(folder / MANIFEST) as unfinished:
        unfinished.write_text(manifest.to_json(), encoding="utf-8")
    (folder / PROGRESS).unlink()
    finish(folder)
    return _summary(folder, manifest, damaged)


def _source(config: DictConfig) -> _Source:
    if config.labels in (None, ""):
        raise ValueError(
            "No landmarks are named: type hand-recon prepare shards labels=<file> images=<folder>."
        )
    if config.group_by not in GROUPS:
        raise ValueError(f"Unknown group_by={config.group_by!r}; choose one of {list(GROUPS)}.")
    if config.images_per_shard < 1:
        raise ValueError(f"images_per_shard={config.images_per_shard}; expected 1 or more.")
    encoding = Encoding(config.max_side, config.jpeg_quality)
    options = {
        key: config[key] for key in ("side", "order", "third_value", "placeholders", "min_side")
    }
    recipe = LandmarkRecipe(
        config.labels, images=config.images, crop=CropPolicy(around=config.around), **options
    )
    table = LandmarkSplits(recipe).training_table
    fields = None if config.fields is None else Path(config.fields).expanduser()
    facts = read_facts(Path(config.labels).expanduser(), fields, plain(config.facts))
    images = _images(table, facts, config.split)
    groups = _groups(table, images, facts, config.group_by)
    return _Source(table, images, groups, facts, encoding)


def _images(table: AnnotatedHands, facts: Facts, split: str | None) -> list[list[int]]:
    """Rows of each image, in the order in which images come first, of one split where one is named."""
    rows: dict[Path, list[int]] = {}
    for row in range(len(table)):
        rows.setdefault(table.images[row], []).append(row)
    images = list(rows.values())
    if split is None:
        return images
    kept = [one for one in images if facts_of(facts, table.source(one[0])).get("split") == split]
    if not kept:
        found = sorted({known["split"] for known in facts.values() if "split" in known})
        raise ValueError(f"No image has the split {split!r}; those that are named are {found}.")
    return kept


def _groups(
    table: AnnotatedHands, images: Sequence[Sequence[int]], facts: Facts, group_by: str
) -> np.ndarray:
    """Number of each hand's group: of its person where one is known, else of its image.

    Groups are numbered from 0 among the hands of the given images; other hands have none (-1).
    """
    rows = sorted(itertools.chain.from_iterable(images))
    scenes = scenes_of(table)
    names = [scenes[row] for row in rows]
    if group_by == "person":
        persons = (facts_of(facts, table.source(row)).get("person") for row in rows)
        names = [
            name if person is None else f"person {person}"
            for name, person in zip(names, persons, strict=True)
        ]
    groups = np.full(len(table), -1)
    groups[rows] = np.unique(names, return_inverse=True)[1]
    return groups


def _write_all(config: DictConfig, source: _Source, folder: Path) -> tuple[list[Shard], list[str]]:
    """Write the shards that are not there yet; returns all of them, and names of unreadable images.

    Raises:
        ValueError: More images than allowed cannot be read.
    """
    size, total = config.images_per_shard, len(source.rows_of_image)
    batches = read_progress(folder / PROGRESS)
    with (
        appending(folder / PROGRESS, batches) as append,
        ThreadPoolExecutor(max(1, config.workers)) as pool,
    ):
        rows = [row for batch in batches for row in batch]
        damaged = [name for row in rows for name in row["damaged"]]
        starts = range(len(rows) * size, total, size)
        if rows:
            logger.info("%d shards are done already.", len(rows))
        for start in with_progress(starts, len(starts), "Writing shards"):
            unreadable: list[str] = []
            numbers = range(start, min(start + size, total))
            images = _readable(source, numbers, pool, unreadable)
            shard = write_shard(folder, f"shard-{start // size:05d}", images)
            damaged += unreadable
            _check_damaged(damaged, config.max_damaged)
            rows.append({"shard": shard and asdict(shard), "damaged": unreadable})
            append(rows[-1:])
    return [Shard.from_json(row["shard"]) for row in rows if row["shard"] is not None], damaged


def _readable(
    source: _Source, numbers: range, pool: ThreadPoolExecutor, unreadable: list[str]
) -> Iterator[ShardImage]:
    """Images in order, some of them read ahead; names of unreadable ones are added to the list."""
    # OpenCV decodes and encodes outside the interpreter's lock, so threads are enough.
    for start in range(numbers.start, numbers.stop, _AT_ONCE):
        for image in pool.map(source.image, range(start, min(start + _AT_ONCE, numbers.stop))):
            if isinstance(image, ShardImage):
                yield image
            else:
                logger.warning("%s is left out: %s.", image.name, image.reason)
                unreadable.append(image.name)


def _check_damaged(damaged: list[str], most: int) -> None:
    if len(damaged) > most:
        raise ValueError(
            f"{len(damaged)} images cannot be read or written, more than max_damaged={most}; the first: "
            f"{', '.join(itertools.islice(damaged, 5))}. The log has the reasons. Copy them again, "
            "or raise max_damaged: the same command goes on where it stopped."
        )


def _manifest(
    config: DictConfig, source: _Source, shards: list[Shard], damaged: list[str]
) -> Manifest:
    if not shards:
        raise ValueError(
            f"None of {len(damaged)} images can be read and written; no shards are written."
        )
    options = {
        key: value
        for key, value in plain(config).items()
        if key not in ("labels", "images", "source", "fields", "output", "paths", "task", "workers")
    }
    return Manifest(
        name=source.table.name,
        around=config.around,
        groups=int(source.groups.max()) + 1,
        shards=tuple(shards),
        landmark_set=config.landmark_set,
        about={"version": __version__, "options": options, "unreadable": damaged},
    )


def _summary(folder: Path, manifest: Manifest, damaged: list[str]) -> dict[str, Any]:
    images = sum(shard.images for shard in manifest.shards)
    size = sum(shard.tar.bytes for shard in manifest.shards)
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(
        f"{folder}: {len(manifest.shards)} shards, {images} images, {manifest.hands} hands, "
        f"{size / 1e6:.1f} MB; {len(damaged)} images were left out."
    )
    known = manifest.landmark_set
    chosen = "" if known in (None, ShardDataModule.landmark_set) else f" data.landmark_set={known}"
    console.print(f"hand-recon train data=shards data.train={folder}{chosen}")
    return {
        "folder": str(folder), "shards": len(manifest.shards), "images": images, "hands": manifest.hands,
        "damaged": damaged,
    }  # fmt: skip
