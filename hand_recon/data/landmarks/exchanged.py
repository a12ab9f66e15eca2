"""Training photographs with exchanged fingers, made once and kept in the cache."""

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool

from hand_recon.data.annotated_dataset import AnnotatedImages
from hand_recon.data.cache import MappedArray, digest, ensure_built
from hand_recon.data.finger_exchange import (
    Donors,
    ExchangeRule,
    Pixels,
    Points,
    choose_donor,
    exchange_finger,
    palm_colour,
    straight_fingers,
)
from hand_recon.data.progress import with_progress
from hand_recon.schema import HandSample

logger = logging.getLogger(__name__)

CANDIDATES: Final = 250
"""Donors that are looked at for one finger."""

TRIES: Final = 60
"""Hands that are tried for one image before a hand is taken as it is."""

MOST_FINGERS: Final = 3
"""Most fingers of one hand that are exchanged."""

VERSION: Final = 2
"""Raised when the same settings give other images."""


@dataclass(frozen=True)
class _Crops:
    """All fully labelled crops of a dataset in memory."""

    images: np.ndarray
    landmarks: np.ndarray
    straight: np.ndarray

    @classmethod
    def of(cls, dataset: AnnotatedImages) -> "_Crops":
        images, landmarks = [], []
        for index in with_progress(range(len(dataset)), len(dataset), "Reading"):
            sample = dataset[index]
            if bool(sample.labelled.all()):
                images.append(sample.image.permute(1, 2, 0).numpy())
                landmarks.append(sample.landmarks_2d.numpy().astype(np.float64))
        points = np.stack(landmarks)
        return cls(np.stack(images), points, straight_fingers(points))


class WithExchangedFingers:
    """A dataset, and as many further hands as asked for, each with one to three fingers of other hands."""

    def __init__(
        self, dataset: AnnotatedImages, count: int, folder: Path, *, seed: int = 0, workers: int = 2
    ) -> None:
        """Make the further hands, unless the cache has them.

        Args:
            dataset: Photographs with landmarks.
            count: Number of further hands.
            folder: Folder of caches.
            seed: Seed of the choices.
            workers: Threads that make them.

        Raises:
            ValueError: Fewer than two hands have all their landmarks.
        """
        self.dataset = dataset
        crop = dataset.reader.crop
        recipe = (
            VERSION,
            dataset.hands.fingerprint,
            sorted(vars(crop).items()),
            dataset.rows,
            count,
            seed,
        )
        target = folder / f"exchanged-{crop.size}-{digest(*recipe)}"

        def build(partial: Path) -> None:
            logger.info("Exchanging fingers of %d hands, once, into %s", count, target)
            _make(dataset, count, partial, seed, workers)

        target.parent.mkdir(parents=True, exist_ok=True)
        ensure_built(target, build)
        self.images = MappedArray(target / "images.npy")
        self.landmarks = torch.from_numpy(np.load(target / "landmarks.npy")).float()

    def __len__(self) -> int:
        return len(self.dataset) + len(self.landmarks)

    def __getitem__(self, index: int) -> HandSample:
        """A hand of the dataset, or after these one with exchanged fingers.

        Raises:
            IndexError: There is no such position.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"Sample {index} of {len(self)}.")
        further = index - len(self.dataset)
        if further < 0:
            return self.dataset[index]
        return HandSample(
            image=torch.from_numpy(self.images[further]),
            landmarks_2d=self.landmarks[further],
            labelled=torch.ones(21, dtype=torch.bool),
            index=index,
            source=f"{self.dataset.hands.name}: exchanged fingers {further}",
        )


def _make(dataset: AnnotatedImages, count: int, folder: Path, seed: int, workers: int) -> None:
    """Write images and landmarks of hands with exchanged fingers."""
    crops = _Crops.of(dataset)
    if len(crops.images) < 2:
        raise ValueError(
            f"{dataset.hands.name} has {len(crops.images)} hands with all landmarks; expected two or "
            "more, to exchange fingers between. Set exchanged=0."
        )
    colours = [palm_colour(*crop) for crop in zip(crops.images, crops.landmarks, strict=True)]
    donors = Donors(crops.landmarks, np.stack(colours))
    shape = (count, 3, *crops.images.shape[1:3])
    images = np.lib.format.open_memmap(folder / "images.npy", "w+", np.uint8, shape)
    landmarks = np.empty((count, 21, 2))

    def one(index: int) -> None:
        random = np.random.default_rng((seed, index))
        pixels, landmarks[index] = _exchanged(crops, donors, random)
        images[index] = pixels.transpose(2, 0, 1)

    # OpenCV works outside the interpreter's lock, so threads are enough.
    with ThreadPoolExecutor(max(1, workers)) as pool:
        for _ in with_progress(pool.map(one, range(count)), count, "Exchanging"):
            pass
    images.flush()
    np.save(folder / "landmarks.npy", landmarks)


def _exchanged(crops: _Crops, donors: Donors, random: np.random.Generator) -> tuple[Pixels, Points]:
    """A hand with one to three fingers of others, by which it gets a combination drawn from all 32.

    Photographs of gestures have few combinations of stretched and bent fingers, and chance would make the
    frequent ones again.
    """
    wanted = _combination(crops, random)
    for attempt in range(TRIES):
        hand = int(random.integers(len(crops.images)))
        if attempt == TRIES // 2:
            # No hand is near to it: another combination.
            wanted = _combination(crops, random)
        fingers = random.permutation(np.flatnonzero(crops.straight[hand] != wanted))
        if not 1 <= len(fingers) <= MOST_FINGERS:
            continue
        found = _with_fingers(crops, donors, random, hand, wanted=wanted, fingers=fingers.tolist())
        if found is not None:
            return found
    hand = int(random.integers(len(crops.images)))
    return crops.images[hand], crops.landmarks[hand]


def _combination(crops: _Crops, random: np.random.Generator) -> Bool[np.ndarray, "finger=5"]:
    """A combination of stretched and bent fingers; a finger that is alike in all hands stays so."""
    varies = crops.straight.any(axis=0) & ~crops.straight.all(axis=0)
    return np.where(varies, random.random(5) < 0.5, crops.straight[0])


def _with_fingers(
    crops: _Crops,
    donors: Donors,
    random: np.random.Generator,
    hand: int,
    *,
    wanted: Bool[np.ndarray, "finger=5"],
    fingers: Sequence[int],
) -> tuple[Pixels, Points] | None:
    """A hand with some fingers of donors, stretched or bent as wanted; None if a finger has no donor."""
    pixels, points = crops.images[hand], crops.landmarks[hand]
    for finger in fingers:
        possible = np.flatnonzero(crops.straight[:, finger] == wanted[finger])
        candidates = possible[random.integers(len(possible), size=CANDIDATES)]
        found = choose_donor(donors, candidates, hand, points, finger=finger, rule=ExchangeRule())
        if found is None or not _inside(crops, found[0], finger):
            return None
        donor, matrix = found
        pixels, points = exchange_finger(
            pixels,
            points,
            crops.images[donor],
            crops.landmarks[donor],
            finger=finger,
            matrix=matrix,
        )
    return pixels, points


def _inside(crops: _Crops, donor: int, finger: int) -> bool:
    """True if a donor's finger is inside its image, not in the black outside of it."""
    height, width = crops.images.shape[1:3]
    places = np.round(crops.landmarks[donor, 1 + 4 * finger : 5 + 4 * finger]).astype(int)
    if (places < 0).any() or (places >= (width, height)).any():
        return False
    return bool(crops.images[donor, places[:, 1], places[:, 0]].any(axis=-1).all())
