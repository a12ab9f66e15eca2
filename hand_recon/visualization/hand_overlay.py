"""Hands drawn on their photograph: mesh, landmarks, σ, verdict, and views from the side and from above."""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.rendering.mesh import BLUE, RotatedView
from hand_recon.rendering.window import MOST_SAMPLES, PlacedMesh, shade_in_image
from hand_recon.visualization.hand_marks import (
    Canvas,
    Place,
    draw_given,
    draw_label,
    draw_skeleton,
    draw_two_sigma,
    hand_size,
    line_width,
    text_strip,
)

logger = logging.getLogger(__name__)

HAND_COLOURS: Final = {"right": BLUE, "left": (165.0, 205.0, 90.0)}
"""RGB colour of the mesh by side: blue and green of different lightness, neither of them like skin."""

LARGEST_DRAWING: Final = 4096
"""Longer side of the photograph in a drawing, pixels; larger photographs are scaled down."""

_PANEL: Final = (128, 1024)
_LARGEST_RENDERED: Final = 400
_MOST_PANELS: Final = 24
_LEAST_CAPTION: Final = 12


@dataclass(frozen=True, kw_only=True)
class DrawnHand:
    """One hand in the frame of its photograph; left hands are left hands."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Vertices, camera frame, metres."""
    landmarks_2d: Float[np.ndarray, "landmark=21 2"]
    """Projected landmarks, pixels of the photograph; pixel i covers [i, i + 1)."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix of the photograph, pixels."""
    side: str
    """"left" or "right"."""
    label: str = ""
    """Number or name of the hand."""
    doubtful: bool = False
    """True for a hand whose result should be looked at."""
    given_2d: Float[np.ndarray, "landmark=21 2"] | None = None
    """Landmarks that the hand was fitted to, pixels; NaN where there is none."""
    sigma_2d: Float[np.ndarray, "landmark=21 2"] | None = None
    """Standard deviation of each landmark along u and v, pixels."""
    covariance: Float[np.ndarray, "landmark=21 2 2"] | None = None
    """Covariance of each landmark, squared pixels; used in place of `sigma_2d`."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"] | None = None
    """Landmarks, camera frame, metres, for the error bars of the views from the side and from above."""
    covariance_3d: Float[np.ndarray, "landmark=21 3 3"] | None = None
    """Covariance of each of `landmarks_3d`, camera's axes, square metres."""

    def __post_init__(self) -> None:
        """Check the side.

        Raises:
            ValueError: It is neither left nor right.
        """
        if self.side not in HAND_COLOURS:
            raise ValueError(f"Found the side {self.side!r}; expected 'left' or 'right'. Name one.")

    @property
    def title(self) -> str:
        """Label, side and verdict in a line."""
        words = [self.label, self.side, "doubtful" if self.doubtful else ""]
        return ", ".join(word for word in words if word)


@dataclass(frozen=True)
class OverlayStyle:
    """Choices of a drawing."""

    opacity: float = 0.65
    """Opacity of the meshes, 0 to 1; with 0 there are none."""
    skeleton: bool = True
    """True to draw the fitted landmarks."""
    panels: bool = True
    """True to draw each hand from the side and from above, beside the photograph."""
    smallest: int = 1
    """Longer side of the photograph in the drawing, pixels; smaller ones are enlarged by a whole number."""
    largest: int = LARGEST_DRAWING
    """Longer side of the photograph in the drawing, pixels; larger ones are scaled down."""
    samples: int = MOST_SAMPLES
    """Most rays that are cast for the meshes of a drawing."""


def draw_hands(
    pixels: UInt8[np.ndarray, "height width 3"],
    hands: Sequence[DrawnHand],
    faces: Int[np.ndarray, "face 3"],
    style: OverlayStyle | None = None,
) -> UInt8[np.ndarray, "drawn_height drawn_width 3"]:
    """Draw hands on a copy of their photograph, in its own resolution within the style's limits.

    Meshes hide each other where one is nearer. Given landmarks are rings, fitted ones dots, ellipses are two
    σ. To the right of the photograph is each hand from the side and from above, for the first 12 hands, with
    ellipses of two σ of its landmarks in 3D. Hands whose vertices are not finite or all behind the camera are
    left out with a warning.

    Args:
        pixels: Photograph, RGB, upright.
        hands: Hands with the same camera frame.
        faces: Triangles of the mesh, in either winding.
        style: Choices; without them, the defaults of `OverlayStyle`.
    """
    style = style or OverlayStyle()
    canvas, scale = _canvas(pixels, style)
    drawn = [_scaled(hand, scale) for hand in hands if _can_be_drawn(hand)]
    height, width, _ = canvas.shape
    meshes = [
        PlacedMesh(hand.vertices, faces, hand.intrinsics, HAND_COLOURS[hand.side]) for hand in drawn
    ]
    if style.opacity > 0:
        for window in shade_in_image(meshes, width, height, style.samples):
            window.blend_into(canvas, style.opacity)
    order = sorted(range(len(drawn)), key=lambda index: -meshes[index].distance)
    for index in order:
        _draw_marks(canvas, drawn[index], style)
    _draw_titles(canvas, drawn)
    return _with_panels(canvas, drawn, faces) if style.panels and drawn else canvas


def _canvas(pixels: UInt8[np.ndarray, "_ _ 3"], style: OverlayStyle) -> tuple[Canvas, float]:
    """Copy a photograph, enlarged or scaled down to the style's limits, with the scale."""
    height, width, _ = pixels.shape
    longer = max(height, width)
    if longer > style.largest:
        scale = style.largest / longer
        size = max(1, round(width * scale)), max(1, round(height * scale))
        logger.info(
            "The drawing of %d × %d pixels is scaled down to %d × %d.", width, height, *size
        )
        small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8), scale
    factor = max(1, min(math.ceil(style.smallest / longer), style.largest // longer))
    if factor == 1:
        return np.array(pixels, order="C"), 1.0
    size = width * factor, height * factor
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_CUBIC), np.uint8), factor


def _can_be_drawn(hand: DrawnHand) -> bool:
    if not (np.isfinite(hand.vertices).all() and np.isfinite(hand.intrinsics).all()):
        logger.warning("Hand %s is not drawn: its mesh is not known.", hand.title)
        return False
    if (hand.vertices[:, 2] <= 0).all():
        logger.warning("Hand %s is not drawn: it is behind the camera.", hand.title)
        return False
    return True


def _scaled(hand: DrawnHand, scale: float) -> DrawnHand:
    """Scale the pixels of a hand."""
    if scale == 1:
        return hand
    return replace(
        hand,
        landmarks_2d=hand.landmarks_2d * scale,
        intrinsics=hand.intrinsics * np.array([[scale], [scale], [1.0]]),
        given_2d=None if hand.given_2d is None else hand.given_2d * scale,
        sigma_2d=None if hand.sigma_2d is None else hand.sigma_2d * scale,
        covariance=None if hand.covariance is None else hand.covariance * scale**2,
    )


def _draw_marks(canvas: Canvas, hand: DrawnHand, style: OverlayStyle) -> None:
    width = line_width(min(hand_size(hand.landmarks_2d), 2.0 * max(canvas.shape)))
    covariance = hand.covariance
    if covariance is None and hand.sigma_2d is not None:
        covariance = np.square(hand.sigma_2d)[:, :, None] * np.eye(2)
    if covariance is not None:
        draw_two_sigma(canvas, hand.landmarks_2d, covariance, width)
    if style.skeleton:
        draw_skeleton(canvas, hand.landmarks_2d, width)
    if hand.given_2d is not None:
        draw_given(canvas, hand.given_2d, hand.landmarks_2d, width)


def _draw_titles(canvas: Canvas, hands: Sequence[DrawnHand]) -> None:
    height, width, _ = canvas.shape
    taken: list[Place] = []
    for hand in hands:
        points = (
            [hand.landmarks_2d] if hand.given_2d is None else [hand.landmarks_2d, hand.given_2d]
        )
        places = np.concatenate(points)
        places = places[np.isfinite(places).all(axis=1)]
        if len(places):
            margin = 4 * line_width(hand_size(places))
            box = np.stack([places.min(axis=0) - margin, places.max(axis=0) + margin])
            box = box.clip(0, (width, height))
            taken.append(draw_label(canvas, hand.title, box, taken, warning=hand.doubtful))
            _draw_leader(canvas, taken[-1], places)


def _draw_leader(canvas: Canvas, label: Place, points: Float[np.ndarray, "point 2"]) -> None:
    """Draw a line from a label to the nearest point of its hand, so that it is seen whose label it is."""
    low = np.array([label.left, label.top], dtype=float)
    high = low + np.array([label.columns, label.rows]) - 1
    ends = points.clip(low, high)
    nearest = int(np.linalg.norm(points - ends, axis=1).argmin())
    if not np.array_equal(ends[nearest], points[nearest]):
        start, end = ends[nearest].round().astype(int), points[nearest].round().astype(int)
        thin = max(1, line_width(hand_size(points)) // 3)
        cv2.line(canvas, start.tolist(), end.tolist(), (40, 40, 40), thin, cv2.LINE_AA)


def _with_panels(
    canvas: Canvas, hands: Sequence[DrawnHand], faces: Int[np.ndarray, "face 3"]
) -> UInt8[np.ndarray, "drawn_height drawn_width 3"]:
    """Set the views of each hand to the right of the photograph, one below the other."""
    height, width, _ = canvas.shape
    side = int(np.clip(height // 2, *_PANEL))
    panels = [panel for hand in hands[: _MOST_PANELS // 2] for panel in _views(hand, faces, side)]
    # Both views of a hand are in one column.
    rows = max(2, height // side // 2 * 2)
    columns = math.ceil(len(panels) / rows)
    tall = max(height, min(rows, len(panels)) * side)
    sheet = np.full((tall, width + columns * side, 3), 255, dtype=np.uint8)
    sheet[:height, :width] = canvas
    for index, panel in enumerate(panels):
        left, top = width + index // rows * side, index % rows * side
        sheet[top : top + side, left : left + side] = panel
    return sheet


def _views(hand: DrawnHand, faces: Int[np.ndarray, "face 3"], side: int) -> list[Canvas]:
    views = []
    uncertain = hand.landmarks_3d is not None and hand.covariance_3d is not None
    for name, view in (
        ("from the side", RotatedView.from_the_side(hand.vertices)),
        ("from above", RotatedView.from_above(hand.vertices)),
    ):
        shown = (hand.label, hand.side, name, "2 sigma" if uncertain else "")
        words = ", ".join(word for word in shown if word)
        strip = text_strip(words, max(_LEAST_CAPTION, side // 28))[:, :side]
        height, width, _ = strip.shape
        panel = np.full((side, side, 3), 255, dtype=np.uint8)
        panel[:height, :width] = strip
        room = side - height
        colour = HAND_COLOURS[hand.side]
        image = view.render(hand.vertices, faces, min(room, _LARGEST_RENDERED), colour)
        image = np.asarray(cv2.resize(image, (room, room), interpolation=cv2.INTER_CUBIC))
        _draw_error_bars(image, hand, view)
        panel[height:, height // 2 : height // 2 + room] = image
        views.append(panel)
    return views


def _draw_error_bars(image: Canvas, hand: DrawnHand, view: RotatedView) -> None:
    """Draw the bones and two σ of the landmarks in a view; nothing for a hand without covariances."""
    if hand.landmarks_3d is None or hand.covariance_3d is None:
        return
    size = image.shape[0]
    pixels = view.project(hand.landmarks_3d, size)
    width = line_width(hand_size(pixels))
    spread = view.project_covariance(hand.landmarks_3d, hand.covariance_3d, size)
    draw_two_sigma(image, pixels, spread, width)
    draw_skeleton(image, pixels, width)
