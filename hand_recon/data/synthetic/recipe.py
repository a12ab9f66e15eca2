"""Parameters of a set of synthetic hands, and the random generators of each image."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hand_recon.data.synthetic.levels import DIFFICULTIES, FEATURES, Level

SPLITS: Final[tuple[str, ...]] = ("train", "val", "test")
"""Splits; training and validation share gestures and palettes, test has others."""


@dataclass(frozen=True)
class Recipe:
    """Parameters that, with the index and the hand asset, determine an image."""

    split: str
    """`train`, `val` or `test`."""
    level: Level
    """Level of difficulty."""
    crop_size: int
    """Side of the square image, pixels. It changes only the resolution, not the hand."""
    seed: int
    """Seed of the whole set."""
    landmark_set: str = "knuckle"
    """The hand's landmark set."""
    pictures: bool = True
    """True renders images. Without images, labels are noisy in the test split too, as a detector's are."""

    def __post_init__(self) -> None:
        """Check the parameters.

        Raises:
            ValueError: The split is unknown, the crop too small or the seed negative.
        """
        if self.split not in SPLITS:
            raise ValueError(f"Unknown split {self.split!r}; synthetic hands have {SPLITS}.")
        if self.crop_size < 16:
            raise ValueError(f"crop_size must be at least 16 pixels, found {self.crop_size}.")
        if self.seed < 0:
            raise ValueError(f"The seed must be at least 0, found {self.seed}.")

    @property
    def clean_labels(self) -> bool:
        """True if labels are exact projections, without simulated annotation noise."""
        return self.held_out and self.pictures

    @property
    def held_out(self) -> bool:
        """True if poses, shapes and appearances do not occur in training."""
        return self.split == "test"

    def random(self, index: int, stream: str) -> np.random.Generator:
        """Random generator of one aspect of one image.

        Each aspect has a separate stream, so that a change to the backgrounds, for example, changes no
        pose. The numbers do not depend on the number of workers or the order of rendering.

        Args:
            index: Index of the image.
            stream: Name of the aspect.
        """
        words = (self.seed, SPLITS.index(self.split), index, zlib.crc32(stream.encode()))
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def level_named(name: str, without: Sequence[str] = ()) -> Level:
    """Look up a level of difficulty.

    Args:
        name: Its name.
        without: Features that its images are to lack, keys of `FEATURES`.

    Raises:
        ValueError: The name or a feature is unknown.
    """
    if name not in DIFFICULTIES:
        raise ValueError(f"Unknown level {name!r}; synthetic hands have {sorted(DIFFICULTIES)}.")
    unknown = sorted(set(without) - set(FEATURES))
    if unknown:
        raise ValueError(f"Found without={unknown}; images can lack {sorted(FEATURES)}.")
    level = DIFFICULTIES[name]
    for feature in sorted(set(without)):
        level = replace(level, name=f"{level.name}-no-{feature}", **FEATURES[feature])
    return level
