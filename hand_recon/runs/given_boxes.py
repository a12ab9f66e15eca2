"""Boxes of hands without landmarks, in the place of a detector: `detector=boxes` or `whole` with `ckpt`."""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from hand_recon.data.crop import whole_image
from hand_recon.detection.box_files import BoxFile, GivenBox
from hand_recon.detection.detector import DetectedHand, Detections, Side

SIDES: Final[dict[str, Side]] = {"left": "left", "right": "right"}
"""Sides by the value of `side`."""


class GivenBoxes:
    """Hands of a file of boxes; no network runs."""

    name: Final = "boxes"

    def __init__(self, boxes: str | Path, min_side: float = 20.0, side: str | None = None) -> None:
        """Read the boxes.

        Args:
            boxes: JSON, COCO or CSV file (`hand_recon/detection/box_files.py` has the forms).
            min_side: Least longer side of a box, pixels.
            side: Side of the hands whose box has none; None for boxes that all have one.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file cannot be used, or a box has no side and `side` is None.
        """
        self.boxes, self.min_side, self.side = BoxFile(boxes), min_side, checked_side(side)
        every = [box for boxes in self.boxes.boxes.values() for box in boxes]
        unknown = sum(box.side is None for box in every)
        if unknown and self.side is None:
            raise ValueError(
                f"{self.boxes.path}: {unknown} of {len(every)} boxes have no side, and the network of ckpt=… "
                "looks at right hands and at mirrored left ones. Write the side beside each box, or add "
                "side=right or side=left for those without one."
            )

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """The hands of an image, in the order of the file.

        Args:
            image: RGB; only its size is looked at.
            file: File of the image, by which its boxes are looked up.

        Raises:
            ValueError: No file was given, or it is not clear which boxes are its own.
        """
        if file is None:
            raise ValueError(
                "detector=boxes looks boxes up by the image's file, and this image is an array. Give its "
                "file, or use detector=whole."
            )
        boxes = self.boxes.of(file)
        if boxes is None:
            return Detections(dropped=(f"{self.boxes.path} has no entry for {file}",))
        hands: list[DetectedHand] = []
        dropped: list[str] = []
        for box in boxes:
            objection = self._objection(box, image.shape[0], image.shape[1])
            if objection is None:
                hands.append(_hand(_corners(box), box.side or self.side or "right"))
            else:
                dropped.append(objection)
        return Detections(tuple(hands), tuple(dropped))

    def _objection(self, box: GivenBox, height: int, width: int) -> str | None:
        """The sentence about a box that shows no hand; None if it can."""
        shown = ", ".join(f"{number:g}" for number in _corners(box))
        if box.right <= 0 or box.bottom <= 0 or box.left >= width or box.top >= height:
            return f"the box {shown} is outside the image of {width} × {height} px"
        longer = max(box.right - box.left, box.bottom - box.top)
        if longer < self.min_side:
            return (
                f"the box {shown} spans {longer:.0f} px, below detector.min_side={self.min_side:g}"
            )
        return None


class WholeImages:
    """Images that are one hand each, all of one side; no network runs."""

    name: Final = "whole"

    def __init__(self, side: str | None = None) -> None:
        """Keep the side.

        Raises:
            ValueError: It is neither `left` nor `right`.
        """
        known = checked_side(side)
        if known is None:
            raise ValueError(
                "detector=whole with ckpt=… needs the side of the hands, because the network looks at right "
                "hands and at mirrored left ones. Add side=right or side=left."
            )
        self.side = known

    def __call__(
        self, image: UInt8[np.ndarray, "height width 3"], file: Path | None = None
    ) -> Detections:
        """The hand of an image, in a square about it.

        Args:
            image: RGB; only its size is looked at.
            file: Not used.
        """
        del file
        square = whole_image(image.shape[0], image.shape[1])
        (x, y), half = square.centre, square.side / 2
        return Detections((_hand((x - half, y - half, x + half, y + half), self.side),))


def checked_side(side: str | None) -> Side | None:
    """Check the side that a user gives.

    Raises:
        ValueError: It is neither `left` nor `right`.
    """
    if side is None:
        return None
    if side not in SIDES:
        raise ValueError(f"Found side={side}; expected side=right or side=left.")
    return SIDES[side]


def _corners(box: GivenBox) -> tuple[float, float, float, float]:
    return box.left, box.top, box.right, box.bottom


def _hand(corners: tuple[float, float, float, float], side: Side) -> DetectedHand:
    unknown = np.full((21, 2), np.nan)
    return DetectedHand(unknown, side, score=None, side_score=1.0, box=np.array(corners))
