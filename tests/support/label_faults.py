"""Faults of labels that a reader returned: infinite ones, and zeros in the place of missing ones."""

import re
from typing import Final

import numpy as np

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.plausibility.given_hands import GivenHands

_NUMBER: Final = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def fault_of_labels(found: object, zeros: float = 0) -> str:
    """Description of labels that should not be; empty without a fault, and for what has no labels.

    Args:
        found: Result of a reader.
        zeros: Number of zeros that its file has; every further one must be a missing label, which is NaN.
    """
    labels = (
        found.landmarks_2d if isinstance(found, ImageLandmarks)
        else found.points if isinstance(found, GivenHands) else None
    )  # fmt: skip
    if labels is None:
        return ""
    if labels.isinf().any():
        return "an infinite label"
    if isinstance(found, ImageLandmarks) and not labels[~found.labelled].isnan().all():
        return "a missing label that is a number"
    return "a label of zero" if int((labels == 0).sum()) > zeros else ""


def zeros_in(content: bytes) -> int:
    """Number of zeros, and of numbers too small for single precision, in the bytes of a text."""
    with np.errstate(all="ignore"):
        return sum(np.float32(float(one)) == 0 for one in _NUMBER.findall(content))
