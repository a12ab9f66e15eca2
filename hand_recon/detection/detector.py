"""Records of detected hands, and the protocol of everything that finds hands in an image."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

Side = Literal["left", "right"]


@dataclass(frozen=True)
class DetectedHand:
    """One hand in an image.

    Landmarks are in the order of `hand_recon.hand.skeleton.LANDMARKS`, which is MediaPipe's.
    """

    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Landmarks, pixels of the image: MediaPipe's normalised coordinates times width and height; NaN for one
    that is missing."""
    side: Side
    """Side of the hand if the image is not mirrored."""
    score: float | None
    """Presence: probability of a hand in the square that the landmark network was given, 0 to 1; none where
    another detector gave no score.
    """
    side_score: float
    """Probability of the side by the landmark network, 0 to 1."""
    palm_score: float | None = None
    """Score of the palm network, 0 to 1; none where a box was given instead of found."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"] | None = None
    """MediaPipe's own estimate, metres, camera axes (x right, y down, z forward), near the palm's centre.

    Its bones do not have the true lengths.
    """
    confidence: Float[np.ndarray, "landmark=21"] | None = None
    """Confidence of each landmark, 0 to 1; none without one."""
    sigma: Float[np.ndarray, "landmark=21"] | None = None
    """Standard deviation of each landmark, pixels of the image; none without one."""
    box: Float[np.ndarray, "4"] | None = None
    """Left, top, right and bottom of a box that was given for the hand, pixels of the image; none without
    one."""


@dataclass(frozen=True)
class Detections:
    """Hands of one image, and what was seen but not taken for a hand."""

    hands: tuple[DetectedHand, ...] = ()
    """Hands, the most certain first."""
    dropped: tuple[str, ...] = ()
    """One sentence for each dropped candidate, with the threshold and the option that sets it."""


@runtime_checkable
class Detector(Protocol):
    """Function that finds the hands of an image."""

    @property
    def name(self) -> str:
        """Name for reports, as in `detector=<name>`."""
        ...

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """Find the hands of an image.

        Args:
            image: RGB, bytes.
            file: File of the image, for detectors that look something up by its name.
        """
        ...
