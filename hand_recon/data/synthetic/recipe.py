"""What a set of synthetic hands is made from, and the random numbers of each picture."""

import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np

from hand_recon.data.synthetic.levels import DIFFICULTIES, Level

SPLITS: Final[tuple[str, ...]] = ("train", "val", "test")
"""Training and validation share gestures and palettes; test has its own."""


@dataclass(frozen=True)
class Recipe:
    """Everything that a picture depends on besides its index and the hand asset."""

    split: str
    """`train`, `val` or `test`."""
    level: Level
    """How hard the pictures are."""
    crop_size: int
    """Side of the square picture, pixels. The hand does not depend on it, only its resolution."""
    seed: int
    """Of the whole set."""
    landmarks: str = "knuckle"
    """The hand's landmark set."""
    pictures: bool = True
    """Whether there are pictures. Without, landmarks are all there is to see, and are noisy in the test
    split too, as a detector's are."""

    def __post_init__(self) -> None:
        """Refuse what cannot be rendered.

        Raises:
            ValueError: The split is unknown, the crop too small or the seed negative.
        """
        if self.split not in SPLITS:
            raise ValueError(f"Unknown split {self.split!r}; synthetic hands have {SPLITS}.")
        if self.crop_size < 16:
            raise ValueError(f"crop_size must be at least 16 pixels, found {self.crop_size}.")
        if self.seed < 0:
            raise ValueError(f"The seed must not be negative, found {self.seed}.")

    @property
    def clean_labels(self) -> bool:
        """Whether labels are true projections rather than what an annotator or detector gives."""
        return self.held_out and self.pictures

    @property
    def held_out(self) -> bool:
        """Whether poses, shapes and appearances are those that training never sees."""
        return self.split == "test"

    def random(self, index: int, stream: str) -> np.random.Generator:
        """The random numbers of one aspect of one picture.

        Aspects have streams of their own, so that a change to, say, the backgrounds leaves every pose as
        it was. Neither the number of workers nor the order of rendering can matter.

        Args:
            index: Which picture.
            stream: Which aspect of it.
        """
        words = (self.seed, SPLITS.index(self.split), index, zlib.crc32(stream.encode()))
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(words)))


def level_named(name: str) -> Level:
    """The level of that name.

    Raises:
        ValueError: There is none.
    """
    if name not in DIFFICULTIES:
        raise ValueError(f"Unknown level {name!r}; synthetic hands have {sorted(DIFFICULTIES)}.")
    return DIFFICULTIES[name]
