"""Rotated, scaled, moved and mirrored copies of a hand's crop, and how far the network's landmarks differ."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.hands import HandReading
from hand_recon.detection.regions import Region, region_of_landmarks

ReadHand = Callable[[UInt8[np.ndarray, "height width 3"], Region], HandReading]
"""Function that reads the hand in a square of an image, such as `LandmarkNetwork`."""


@dataclass(frozen=True)
class Copy:
    """Change of the square around a hand."""

    degrees: float = 0.0
    """Angle by which the square is rotated."""
    scale: float = 1.0
    """Factor on its side."""
    right: float = 0.0
    """Distance by which it is moved to the right in the image, sides."""
    down: float = 0.0
    """Distance by which it is moved down in the image, sides."""
    mirrored: bool = False
    """True for a crop reversed from left to right."""

    def of(self, region: Region) -> Region:
        """The changed square.

        Args:
            region: The square around a hand.
        """
        return Region(
            region.x + self.right * region.side,
            region.y + self.down * region.side,
            self.scale * region.side,
            region.rotation + math.radians(self.degrees),
            self.mirrored,
        )


COPIES: Final = (
    Copy(),
    Copy(25, 1.0, -0.04, 0.0),
    Copy(-12, 1.0, 0.0, -0.04),
    Copy(-25, 0.87, 0.04, 0.04, mirrored=True),
    Copy(-12, 1.15, 0.0, 0.0, mirrored=True),
    Copy(12, 1.0, 0.0, -0.04),
    Copy(-25, 1.0, 0.04, 0.0),
    Copy(25, 1.15, -0.04, 0.0, mirrored=True),
)
"""The copies, in the order of their use; the first is the square in which MediaPipe follows a hand."""


def read_copies(
    read: ReadHand,
    image: UInt8[np.ndarray, "height width 3"],
    reading: HandReading,
    count: int,
) -> Float[np.ndarray, "copy landmark=21 2"]:
    """Read a hand again in copies of the square around its landmarks.

    Args:
        read: Reads the hand in a square.
        image: RGB, bytes.
        reading: The first reading of the hand.
        count: Number of copies, up to that of `COPIES`.

    Returns:
        Landmarks of each copy, pixels of the image.
    """
    square = region_of_landmarks(reading.landmarks_2d)
    places = [read(image, copy.of(square)).landmarks_2d for copy in COPIES[:count]]
    return np.array(places, dtype=np.float64).reshape(-1, 21, 2)


def spread_of_copies(
    landmarks: Float[np.ndarray, "landmark=21 2"],
    copies: Float[np.ndarray, "copy landmark=21 2"],
) -> Float[np.ndarray, "landmark=21"]:
    """Root mean square of the copies' distances from given landmarks, per coordinate, in their unit.

    Args:
        landmarks: The first reading's landmarks.
        copies: The copies' landmarks, one copy or more.
    """
    squared = np.square(copies - landmarks).sum(axis=-1).mean(axis=0)
    return np.asarray(np.sqrt(squared / 2), dtype=np.float64)
