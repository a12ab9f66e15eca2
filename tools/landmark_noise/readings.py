"""Readings of hands and of transformed copies of their crops, for the table of σ and its calibration."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.copies import COPIES, read_copies, spread_of_copies
from hand_recon.detection.hands import HandReading
from hand_recon.detection.landmark_noise import Features, features
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.regions import Region, region_of_landmarks

Image = UInt8[np.ndarray, "height width 3"]

SQUARE: Final = 224
"""Side of the hand's square in whose pixels σ is reported."""


class Recorder:
    """The landmark network, with a record of what it read."""

    def __init__(self, detector: MediaPipeDetector) -> None:
        """Put the recorder into the place of a detector's landmark network.

        Args:
            detector: The detector, which is changed.
        """
        self.network = detector.read_hand
        self.readings: list[HandReading] = []
        vars(detector)["read_hand"] = self

    def __call__(self, image: Image, region: Region) -> HandReading:
        """Read a hand, and record it."""
        self.readings.append(self.network(image, region))
        return self.readings[-1]


@dataclass(frozen=True)
class CopiedHand:
    """One hand, read once and in copies."""

    reading: HandReading
    """The first reading."""
    copies: Float[np.ndarray, "copy landmark=21 2"]
    """Landmarks in the copies, pixels of the image."""
    features: Features
    """Features of the first reading."""

    @property
    def side(self) -> float:
        """Side of the hand's square, pixels."""
        return region_of_landmarks(self.reading.landmarks_2d).side

    def spread(self, count: int) -> Float[np.ndarray, "landmark=21"]:
        """Spread of the first copies, sides of the square.

        Args:
            count: Number of copies.
        """
        return spread_of_copies(self.reading.landmarks_2d, self.copies[:count]) / self.side


def read_hands(images: Iterable[Image]) -> list[CopiedHand | None]:
    """Read the most certain hand of each image, and all its copies; none where no hand is found.

    Args:
        images: RGB, bytes.
    """
    detector = MediaPipeDetector(max_hands=1, min_palm_score=0.4, copies=0)
    recorder = Recorder(detector)
    return [_read_hand(image, detector, recorder) for image in images]


def _read_hand(image: Image, detector: MediaPipeDetector, recorder: Recorder) -> CopiedHand | None:
    recorder.readings.clear()
    if not detector(image).hands:
        return None
    # With one hand at most, the last palm that was looked at is the hand.
    reading = recorder.readings[-1]
    copies = read_copies(recorder.network, image, reading, len(COPIES))
    return CopiedHand(reading, copies, features(reading, image.shape[0], image.shape[1]))
