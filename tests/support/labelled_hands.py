"""Labelled hands and images for the tests of `prepare labels`, with random landmarks."""

import numpy as np

from hand_recon.detection.detector import DetectedHand
from hand_recon.detection.detector import Side as Side
from hand_recon.runs.labelling.label_records import LabelledHand, LabelledImage

SIZE = (400, 300)
"""Width and height of the images, pixels."""

MARKS = {"low score": "The presence is 0.5.", "uncertain landmarks": "σ is large."}
"""Marks of a doubtful hand."""


def labelled(seed: int = 0, side: str = "right", *, doubtful: bool = False) -> LabelledHand:
    """A hand at random places inside of the image."""
    rng = np.random.default_rng(seed)
    return LabelledHand(
        rng.uniform(20, 280, (21, 2)).round(2), side, 0.98, 0.97, rng.uniform(1, 5, 21).round(3),
        reasons=MARKS if doubtful else {},
    )  # fmt: skip


def image(name: str, *hands: LabelledHand) -> LabelledImage:
    """An image of `SIZE` with hands."""
    return LabelledImage(name, SIZE, hands)


def detected(
    landmarks: np.ndarray, side: Side = "right", *, score: float = 0.99, side_score: float = 0.99,
    sigma: float | None = 1.0,
) -> DetectedHand:  # fmt: skip
    """A detected hand with one σ for all landmarks."""
    deviations = None if sigma is None else np.full(21, sigma)
    return DetectedHand(landmarks, side, score, side_score, sigma=deviations)


def square(side: float = 100.0, left: float = 50.0, top: float = 50.0) -> np.ndarray:
    """21 landmarks along the diagonal of a square."""
    return np.linspace((left, top), (left + side, top + side), 21)
