"""Landmarks of one hand: MediaPipe's landmark network, and the rule that no hand is reported twice.

Constants are those of MediaPipe 0.10.21: modules/hand_landmark/hand_landmark_cpu.pbtxt and, for hands found
twice, hand_landmarks_deduplication_calculator.cc of its Tasks API.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.detector import Side
from hand_recon.detection.interpreter import Network
from hand_recon.detection.palms import overlaps
from hand_recon.detection.regions import Region, region_of_landmarks

PALM_TRIANGLE: Final = (0, 5, 17)
"""Wrist and the MCPs of index and little finger, whose longest distance is a hand's size."""

SAME_DISTANCE: Final = 0.2
"""Distance within which two landmarks are the same, in sizes of the larger hand."""

SAME_LANDMARKS: Final = 10
"""Number of such landmarks from which on two hands are one."""

SAME_OVERLAP: Final = 0.2
"""Intersection over union of boxes, above which two hands can be one."""

TWIN_DISTANCE: Final = 0.35
"""Mean distance of two hands' landmarks, in extents of the larger, below which one can be a false twin."""

TWIN_OVERLAP: Final = 0.1
"""Intersection over union of boxes, above which one can be a false twin."""

TWIN_PRESENCE: Final = 0.95
"""Presence from which on a hand is no false twin: two hands may lie over each other (decision 55)."""

CERTAIN: Final = 0.99
"""Presence from which on no other rotation of a box is tried (decision 54)."""


@dataclass(frozen=True)
class HandReading:
    """The landmark network's answer for one square of an image."""

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Landmarks, pixels of the image."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"]
    """Landmarks, metres, camera axes."""
    presence: float
    """Probability of a hand, 0 to 1."""
    right: float
    """Probability of a right hand, if the image is not mirrored, 0 to 1."""
    sigma: Float[np.ndarray, "landmark=21"] | None = None
    """Standard deviation of each landmark, pixels of the image; none before it is estimated."""

    @property
    def side(self) -> Side:
        """The more probable side."""
        return "right" if self.right > 0.5 else "left"

    @property
    def side_score(self) -> float:
        """Probability of that side, 0.5 to 1."""
        return max(self.right, 1 - self.right)

    @property
    def box(self) -> Float[np.ndarray, "4"]:
        """Left, top, right and bottom of the landmarks, pixels."""
        return np.concatenate([self.landmarks_2d.min(axis=0), self.landmarks_2d.max(axis=0)])

    @property
    def extent(self) -> float:
        """Longer side of that box, pixels."""
        return float((self.box[2:] - self.box[:2]).max())


class LandmarkNetwork:
    """MediaPipe's landmark network: 21 landmarks of the hand in a square of an image."""

    def __init__(self, model: Callable[[], bytes], threads: int = 1) -> None:
        """Store the network, which is loaded at the first image."""
        self.network = Network(model, threads)

    def __call__(self, image: UInt8[np.ndarray, "height width 3"], region: Region) -> HandReading:
        """Read the hand in a square, whose fingers should point up in it.

        Args:
            image: RGB, bytes.
            region: The square.
        """
        size = self.network.input_size
        screen, presence, right, world = self.network(region.crop(image, size))
        places = screen.reshape(21, 3)[:, :2].astype(np.float64)
        affine = region.crop_to_image(size)
        to_image = np.eye(3)
        to_image[:2, :2] = region.axes
        return HandReading(
            places @ affine[:, :2].T + affine[:, 2],
            world.reshape(21, 3).astype(np.float64) @ to_image.T,
            float(presence[0]),
            1 - float(right[0]) if region.mirrored else float(right[0]),
        )

    def look_twice(self, image: UInt8[np.ndarray, "height width 3"], region: Region) -> HandReading:
        """Read the hand in a square, then in the square around the landmarks that were read."""
        first = self(image, region)
        return self(image, region_of_landmarks(first.landmarks_2d))

    def read_box(self, image: UInt8[np.ndarray, "height width 3"], region: Region) -> HandReading:
        """Read a hand of unknown direction: upright first, then upside down and on either side.

        Args:
            image: RGB, bytes.
            region: An upright square around the hand.

        Returns:
            The first reading that is certain, otherwise that of the highest presence.
        """
        best: HandReading | None = None
        for rotation in (0.0, math.pi / 2, -math.pi / 2, -math.pi):
            reading = self.look_twice(image, Region(region.x, region.y, region.side, rotation))
            if best is None or reading.presence > best.presence:
                best = reading
            if best.presence >= CERTAIN:
                break
        if best is None:
            raise AssertionError
        return best


def is_same_hand(one: HandReading, other: HandReading) -> bool:
    """True if two readings are of one hand, by MediaPipe's rule.

    At least `SAME_LANDMARKS` landmarks are the same, and the boxes overlap.
    """
    near = SAME_DISTANCE * max(_palm_size(one), _palm_size(other))
    distances = np.linalg.norm(one.landmarks_2d - other.landmarks_2d, axis=1)
    enough = int((distances < near).sum()) >= SAME_LANDMARKS
    return enough and float(overlaps(one.box, other.box[None])[0]) > SAME_OVERLAP


def is_false_twin(one: HandReading, other: HandReading) -> bool:
    """True if a reading is a second, worse one of the hand of another reading.

    MediaPipe's rule leaves readings of one hand in which fingers are exchanged or the side is another. Such a
    reading lies over the better one and has a lower presence.
    """
    if one.presence >= min(TWIN_PRESENCE, other.presence):
        return False
    extent = max(one.extent, other.extent)
    distances = np.linalg.norm(one.landmarks_2d - other.landmarks_2d, axis=1)
    near = float(distances.mean()) < TWIN_DISTANCE * extent
    return near and float(overlaps(one.box, other.box[None])[0]) > TWIN_OVERLAP


def is_repeated(reading: HandReading, earlier: Sequence[HandReading]) -> bool:
    """True if a reading is of a hand that was read before."""
    return any(is_same_hand(reading, one) for one in earlier)


def _palm_size(reading: HandReading) -> float:
    """Longest side of the triangle of wrist and two MCPs, pixels."""
    corners = reading.landmarks_2d[list(PALM_TRIANGLE)]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max())
