"""MediaPipe's hand detection: palms in the whole image, then the landmarks of each hand."""

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from hand_recon.detection.detector import Detections
from hand_recon.detection.hands import LandmarkNetwork
from hand_recon.detection.landmark_noise import LandmarkNoise
from hand_recon.detection.looks import Look
from hand_recon.detection.model_download import model_loader
from hand_recon.detection.models import LANDMARKS, PALMS
from hand_recon.detection.palms import Palm, PalmNetwork, best_of_overlapping
from hand_recon.detection.thresholds import Thresholds, check_share

AUTO_PADDING: Final = 1.7
"""The second padding of `padding=auto`, in longer sides of the image (decision 55)."""


class MediaPipeDetector:
    """Hands of an image by MediaPipe's two networks; their models are prepared at the first need."""

    name: Final = "mediapipe"

    def __init__(
        self,
        *,
        max_hands: int | None = None,
        min_palm_score: float = 0.5,
        min_presence: float = 0.5,
        min_side: float = 20.0,
        padding: float | str = "auto",
        copies: int = 1,
        threads: int = 1,
        models: str | Path | None = None,
    ) -> None:
        """Check the options; nothing is loaded yet.

        Args:
            max_hands: Largest number of hands of an image, the best palms first; none for all.
            min_palm_score: Least score of a palm, 0 to 1.
            min_presence: Least presence of a hand, 0 to 1.
            min_side: Least extent of a hand's landmarks, pixels.
            padding: Side of the square in which palms are looked for, in longer sides of the image. More than
                1 finds hands that fill the image, and misses small ones. `auto`: both 1 and 1.7, and the
                better palm of those that overlap.
            copies: Number of transformed copies of a hand that are read for σ, 0 to 8 (decision 68).
            threads: Number of threads of each network.
            models: Folder of the models; none for the cache's.

        Raises:
            ValueError: An option is out of its range.
        """
        check_share("min_palm_score", min_palm_score)
        if max_hands is not None and max_hands < 1:
            raise ValueError(
                f"Expected detector.max_hands of at least 1, or null for all hands, found {max_hands}."
            )
        self.paddings = _paddings(padding)
        self.max_hands = max_hands
        self.min_palm_score = min_palm_score
        self.thresholds = Thresholds(min_presence, min_side)
        self.noise = LandmarkNoise(copies)
        self.find_palms = PalmNetwork(model_loader(PALMS, models), threads)
        self.read_hand = LandmarkNetwork(model_loader(LANDMARKS, models), threads)

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """Find the hands of an image.

        Args:
            image: RGB, bytes.
            file: Not used.

        Raises:
            ModuleNotFoundError: LiteRT is not installed.
            ModelsError: The models cannot be had.
        """
        look = Look(self.thresholds)
        for palm in self.palms(image):
            doubt = self.doubt(palm, len(look.readings))
            if doubt is None:
                look.add(self.read_hand(image, palm.region), palm)
            else:
                look.dropped.append(doubt)
        return look.detections(partial(self.noise, self.read_hand, image))

    def palms(self, image: UInt8[np.ndarray, "height width 3"]) -> list[Palm]:
        """Palms of every padding, the best first; of those that overlap, the best.

        Args:
            image: RGB, bytes.
        """
        palms = [
            palm
            for padding in self.paddings
            for palm in self.find_palms(image, self.min_palm_score, padding)
        ]
        # One padding's palms overlap with each other only where suppression left them.
        return palms if len(self.paddings) == 1 else best_of_overlapping(palms)

    def doubt(self, palm: Palm, found: int) -> str | None:
        """The sentence about a palm that is not looked at more closely; none if it is.

        Args:
            palm: The palm.
            found: Number of hands that were found already.
        """
        subject = f"a palm of score {palm.score:.2f}"
        if palm.score < self.min_palm_score:
            return f"{subject} is below detector.min_palm_score={self.min_palm_score:g}"
        if self.max_hands is not None and found >= self.max_hands:
            return f"{subject} is one more than detector.max_hands={self.max_hands}"
        return None


def _paddings(padding: float | str) -> tuple[float, ...]:
    """The paddings to look with, in order.

    Raises:
        ValueError: It is neither `auto` nor a number of at least 1.
    """
    if padding == "auto":
        return (1.0, AUTO_PADDING)
    if isinstance(padding, str) or not 1 <= padding <= 10:
        raise ValueError(
            f"Expected detector.padding=auto or a number from 1 (none) to 10, found {padding}."
        )
    return (float(padding),)
