"""Landmarks, ellipses and labels of hands on photographs of any size, with lines in proportion to the hand.

Each mark touches only the pixels around it, so that the size of the photograph does not matter. In contrast
to `overlay.py` and `ellipses.py`, which draw copies of square crops, these functions change the image.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from hand_recon.hand.skeleton import LANDMARK_PARENTS
from hand_recon.visualization.ellipses import principal_axes
from hand_recon.visualization.overlay import FINGER_COLOURS

Canvas = UInt8[np.ndarray, "height width 3"]
"""RGB image that is drawn on."""

ELLIPSE: Final = 2.0
"""Half axes of the ellipses, in σ."""

_FRACTION_BITS: Final = 4
_FARTHEST: Final = 2**26
_LINES_PER_HAND: Final = 120
_ELLIPSE_OPACITY: Final = 0.25
_WHITE: Final = (255, 255, 255)


@dataclass(frozen=True)
class Place:
    """Rectangle of a label, pixels."""

    left: int
    top: int
    columns: int
    rows: int

    def overlaps(self, other: "Place") -> bool:
        """True if two rectangles share a pixel."""
        beside = self.left >= other.left + other.columns or other.left >= self.left + self.columns
        apart = self.top >= other.top + other.rows or other.top >= self.top + self.rows
        return not (beside or apart)


def hand_size(points: Float[np.ndarray, "point 2"]) -> float:
    """Longer side of the box about the finite points, pixels; 0 without any."""
    finite = points[np.isfinite(points).all(axis=1)]
    return float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0


def line_width(size: float) -> int:
    """Width of a skeleton's lines for a hand of a size in pixels; at least 1 pixel."""
    return max(1, round(size / _LINES_PER_HAND))


def draw_skeleton(
    canvas: Canvas, landmarks: Float[np.ndarray, "landmark=21 2"], width: int
) -> None:
    """Draw bones and landmarks in the fingers' colours; what is not finite is left out.

    Args:
        canvas: Image, changed.
        landmarks: Pixels, pixel i covering [i, i + 1).
        width: Width of the lines, pixels.
    """
    shown = np.isfinite(landmarks).all(axis=1)
    for child, parent in enumerate(LANDMARK_PARENTS):
        if parent >= 0 and shown[child] and shown[parent]:
            ends = _fixed(landmarks[parent] - 0.5), _fixed(landmarks[child] - 0.5)
            cv2.line(canvas, *ends, _colour(child), width, cv2.LINE_AA, _FRACTION_BITS)
    for child in np.flatnonzero(shown).tolist():
        _disc(canvas, landmarks[child], 1.5 * width, (_WHITE, _colour(child)))


def draw_given(
    canvas: Canvas,
    given: Float[np.ndarray, "landmark=21 2"],
    found: Float[np.ndarray, "landmark=21 2"],
    width: int,
) -> None:
    """Draw the given landmarks as rings, each with a line to where the fitted hand has it.

    Args:
        canvas: Image, changed.
        given: Pixels; NaN where there is none.
        found: Projected landmarks of the hand, pixels.
        width: Width of the lines, pixels.
    """
    shown = np.isfinite(given).all(axis=1)
    linked = shown & np.isfinite(found).all(axis=1)
    thin = max(1, width // 2)
    for index in np.flatnonzero(shown).tolist():
        if linked[index]:
            ends = _fixed(given[index] - 0.5), _fixed(found[index] - 0.5)
            cv2.line(canvas, *ends, _WHITE, thin, cv2.LINE_AA, _FRACTION_BITS)
        centre, radius = _fixed(given[index] - 0.5), round(2.5 * width * 2**_FRACTION_BITS)
        for colour, ring in ((_WHITE, thin + 1 + thin // 3), (_colour(index), thin)):
            cv2.circle(canvas, centre, radius, colour, ring, cv2.LINE_AA, _FRACTION_BITS)


def draw_two_sigma(
    canvas: Canvas,
    landmarks: Float[np.ndarray, "landmark=21 2"],
    covariance: Float[np.ndarray, "landmark=21 2 2"],
    width: int,
) -> None:
    """Draw the ellipse of two σ about each landmark, large ones first.

    Args:
        canvas: Image, changed.
        landmarks: Centres, pixels.
        covariance: Covariance of each landmark, squared pixels; NaN where it is unknown.
        width: Width of the lines, pixels.
    """
    shown = np.isfinite(landmarks).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    halves, angles = principal_axes(np.where(shown[:, None, None], covariance, 0.0))
    for index in np.argsort(-halves.prod(axis=1)).tolist():
        if shown[index]:
            ellipse = _Ellipse(landmarks[index], ELLIPSE * halves[index], float(angles[index]))
            _draw_ellipse(canvas, ellipse, _colour(index), max(1, width // 2))


def draw_label(
    canvas: Canvas,
    text: str,
    box: Float[np.ndarray, "2 2"],
    taken: Sequence[Place] = (),
    *,
    warning: bool,
) -> Place:
    """Write a text above a hand, or below or beside it where that place is taken.

    Args:
        canvas: Image, changed.
        text: One line. Letters that Pillow's own font lacks become boxes.
        box: Least and greatest u and v of the hand, pixels.
        taken: Places of earlier labels.
        warning: True for black on yellow in place of white on dark grey.

    Returns:
        Where the text was written.
    """
    height, width, _ = canvas.shape
    letters = np.clip(0.07 * np.ptp(box, axis=0).max(), 11, max(11, 0.045 * max(height, width)))
    strip = text_strip(text, round(letters), warning=warning)[:height, :width]
    rows, columns, _ = strip.shape
    (left, top), (right, bottom) = box
    corners = [
        (left, top - rows), (left, bottom), (right, top), (left - columns, top),
        (left, top - 2 * rows), (left, bottom + rows), (left, top),
    ]  # fmt: skip
    places = [_inside(corner, columns, rows, (width, height)) for corner in corners]
    free = [place for place in places if not any(place.overlaps(other) for other in taken)]
    # A place that had to be shifted into the image may cover the hand.
    hand = Place(int(left), int(top), max(1, int(right - left)), max(1, int(bottom - top)))
    beside = [place for place in free if not place.overlaps(hand)]
    chosen = (beside or free or places)[0]
    canvas[chosen.top : chosen.top + rows, chosen.left : chosen.left + columns] = strip
    return chosen


def text_strip(text: str, height: int, *, warning: bool = False) -> Canvas:
    """Draw a line of text on a plain strip.

    Args:
        text: One line.
        height: Height of the letters, pixels.
        warning: True for black on yellow in place of white on dark grey.
    """
    font = ImageFont.load_default(size=height)
    left, top, right, bottom = font.getbbox(text)
    edge = max(2, height // 4)
    size = (math.ceil(right - left) + 2 * edge, math.ceil(bottom - top) + 2 * edge)
    ink, paper = ("black", (255, 200, 40)) if warning else ("white", (40, 40, 40))
    strip = Image.new("RGB", size, paper)
    ImageDraw.Draw(strip).text((edge - left, edge - top), text, fill=ink, font=font)
    return np.array(strip)


@dataclass(frozen=True)
class _Ellipse:
    centre: Float[np.ndarray, "2"]
    halves: Float[np.ndarray, "2"]
    angle: float


def _draw_ellipse(
    canvas: Canvas, ellipse: _Ellipse, colour: tuple[int, int, int], width: int
) -> None:
    height, columns, _ = canvas.shape
    reach = ellipse.halves.max() + width + 2
    low = np.floor(ellipse.centre - reach).clip(0, (columns, height)).astype(int)
    high = np.ceil(ellipse.centre + reach).clip(0, (columns, height)).astype(int)
    part = canvas[low[1] : high[1], low[0] : high[0]]
    if part.size == 0:
        return
    halves = np.minimum(ellipse.halves, 4.0 * max(height, columns))
    for thickness, opacity in ((cv2.FILLED, _ELLIPSE_OPACITY), (width, 0.8)):
        layer = part.copy()
        cv2.ellipse(
            layer, _fixed(ellipse.centre - low - 0.5), _fixed(halves), float(np.degrees(ellipse.angle)),
            0, 360, colour, thickness, cv2.LINE_AA, _FRACTION_BITS,
        )  # fmt: skip
        part[:] = cv2.addWeighted(layer, opacity, np.ascontiguousarray(part), 1 - opacity, 0)


def _disc(
    canvas: Canvas,
    centre: Float[np.ndarray, "2"],
    radius: float,
    colours: tuple[tuple[int, int, int], tuple[int, int, int]],
) -> None:
    """Draw a disc with an edge: the edge's colour first."""
    place = _fixed(centre - 0.5)
    for colour, share in zip(colours, (1.0, 0.7), strict=True):
        reach = round(radius * share * 2**_FRACTION_BITS)
        cv2.circle(canvas, place, reach, colour, cv2.FILLED, cv2.LINE_AA, _FRACTION_BITS)


def _colour(landmark: int) -> tuple[int, int, int]:
    return FINGER_COLOURS[max(landmark - 1, 0) // 4]


def _inside(corner: tuple[float, float], columns: int, rows: int, size: tuple[int, int]) -> Place:
    """Shift a rectangle into the image."""
    left = int(np.clip(corner[0], 0, size[0] - columns))
    top = int(np.clip(corner[1], 0, size[1] - rows))
    return Place(left, top, columns, rows)


def _fixed(pixels: Float[np.ndarray, "2"]) -> tuple[int, int]:
    # OpenCV's pixel centres are at whole numbers; coordinates are in 1/16 pixel.
    bounded = (pixels * 2**_FRACTION_BITS).clip(-_FARTHEST, _FARTHEST).round()
    return int(bounded[0]), int(bounded[1])
