"""Hands in boxes that the user gives, and the hand that fills an image: no palm is looked for."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from hand_recon.detection.box_files import BoxFile, GivenBox
from hand_recon.detection.detector import DetectedHand, Detections
from hand_recon.detection.hands import LandmarkNetwork
from hand_recon.detection.landmark_noise import LandmarkNoise
from hand_recon.detection.model_download import model_loader
from hand_recon.detection.models import LANDMARKS
from hand_recon.detection.regions import Region, region_of_image
from hand_recon.detection.thresholds import Thresholds, to_hand

MARGIN: Final = 1.6
"""Side of the first square, in longer sides of the box (decision 54)."""

WHOLE_MARGIN: Final = 1.2
"""Side of the first square, in longer sides of the image (decision 54)."""


class _SquareReader:
    """Reads the hand of one square of an image, up to four directions of it."""

    def __init__(
        self,
        thresholds: Thresholds,
        margin: float,
        copies: int,
        threads: int,
        models: str | Path | None,
    ) -> None:
        if not 0.5 <= margin <= 5:
            raise ValueError(f"Expected detector.margin between 0.5 and 5, found {margin:g}.")
        self.margin, self.thresholds = margin, thresholds
        self.noise = LandmarkNoise(copies)
        self.read_hand = LandmarkNetwork(model_loader(LANDMARKS, models), threads)

    def read(
        self, image: UInt8[np.ndarray, "height width 3"], region: Region
    ) -> DetectedHand | str:
        """The hand in a region that is enlarged by the margin, or the reason why it is none."""
        square = replace(region, side=self.margin * region.side)
        reading = self.read_hand.read_box(image, square)
        objection = self.thresholds.objection(reading)
        if objection is not None:
            return objection
        return to_hand(self.noise(self.read_hand, image, reading))


class BoxDetector(_SquareReader):
    """Landmarks of the hands in given boxes.

    The landmark network reads the box's square, then the square around the landmarks that it found, in up to
    four directions until it is certain.
    """

    name: Final = "boxes"

    def __init__(
        self,
        boxes: str | Path,
        *,
        min_presence: float = 0.5,
        min_side: float = 20.0,
        margin: float = MARGIN,
        copies: int = 0,
        threads: int = 1,
        models: str | Path | None = None,
    ) -> None:
        """Read the boxes.

        Args:
            boxes: JSON, COCO or CSV file (`hand_recon/detection/box_files.py` has the forms).
            min_presence: Least presence of a hand, 0 to 1.
            min_side: Least extent of a hand's landmarks, pixels.
            margin: Side of the first square, in longer sides of the box.
            copies: Number of transformed copies of a hand that are read for σ, 0 to 8 (decision 68).
            threads: Number of threads of the network.
            models: Folder of the models; none for the cache's.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file or an option cannot be used.
        """
        super().__init__(Thresholds(min_presence, min_side), margin, copies, threads, models)
        self.boxes = BoxFile(boxes)

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """Read the hands of an image in its boxes, in their order.

        Args:
            image: RGB, bytes.
            file: File of the image, by which its boxes are looked up.

        Raises:
            ValueError: No file was given, or it is not clear which boxes are its own.
        """
        if file is None:
            raise ValueError("detector=boxes looks boxes up by the image's file; give file=<path>.")
        boxes = self.boxes.of(file)
        if boxes is None:
            return Detections(dropped=(f"{self.boxes.path} has no entry for {file}",))
        hands: list[DetectedHand] = []
        dropped: list[str] = []
        for box in boxes:
            found = self._read_box(image, box)
            if isinstance(found, str):
                dropped.append(found)
            else:
                hands.append(found)
        return Detections(tuple(hands), tuple(dropped))

    def _read_box(
        self, image: UInt8[np.ndarray, "height width 3"], box: GivenBox
    ) -> DetectedHand | str:
        height, width = image.shape[:2]
        if box.right <= 0 or box.bottom <= 0 or box.left >= width or box.top >= height:
            return (
                f"the box {box.left:g}, {box.top:g}, {box.right:g}, {box.bottom:g} is outside the image of "
                f"{width} × {height} px"
            )
        side = max(box.right - box.left, box.bottom - box.top)
        hand = self.read(
            image, Region((box.left + box.right) / 2, (box.top + box.bottom) / 2, side)
        )
        if isinstance(hand, str) or box.side in (None, hand.side):
            return hand
        return replace(hand, side=box.side, side_score=1 - hand.side_score)


class WholeImageDetector(_SquareReader):
    """Landmarks of the one hand that fills an image."""

    name: Final = "whole"

    def __init__(
        self,
        *,
        min_presence: float = 0.5,
        min_side: float = 20.0,
        margin: float = WHOLE_MARGIN,
        copies: int = 0,
        threads: int = 1,
        models: str | Path | None = None,
    ) -> None:
        """Check the options; nothing is loaded yet.

        Args:
            min_presence: Least presence of a hand, 0 to 1.
            min_side: Least extent of a hand's landmarks, pixels.
            margin: Side of the first square, in longer sides of the image.
            copies: Number of transformed copies of a hand that are read for σ, 0 to 8 (decision 68).
            threads: Number of threads of the network.
            models: Folder of the models; none for the cache's.

        Raises:
            ValueError: An option is out of its range.
        """
        super().__init__(Thresholds(min_presence, min_side), margin, copies, threads, models)

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """Read the hand of an image.

        Args:
            image: RGB, bytes.
            file: Not used.
        """
        found = self.read(image, region_of_image(image.shape[0], image.shape[1]))
        return (
            Detections(dropped=(found,)) if isinstance(found, str) else Detections(hands=(found,))
        )
