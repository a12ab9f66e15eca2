"""Frames of a clip with their hands: meshes over the image, and each hand from the side, in one layout."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from hand_recon.rendering.mesh import from_the_side
from hand_recon.visualization.hand_marks import Canvas, text_strip
from hand_recon.visualization.hand_overlay import (
    HAND_COLOURS,
    DrawnHand,
    OverlayStyle,
    draw_hands,
)

CLIP_STYLE: Final = OverlayStyle(panels=False, largest=1280, samples=50_000)
"""Drawing of a frame: coarser meshes than on a photograph, which take a tenth of the time."""

MOST_PANELS: Final = 4
"""Most hands that are shown from the side."""

_PANEL: Final = (96, 360)
_LARGEST_RENDERED: Final = 120
_TEXT: Final = 12


@dataclass(frozen=True)
class ClipLayout:
    """Panels beside the frames of a clip, the same in every frame."""

    titles: Mapping[int, str]
    """Title of each hand's panel by its number, such as `1, left`, in order; at most `MOST_PANELS`."""
    panels: bool = True
    """True to show each hand from the side, beside the frame."""

    @property
    def shown(self) -> tuple[int, ...]:
        """Numbers of the hands that have a panel."""
        return tuple(self.titles) if self.panels else ()


def draw_clip_frame(
    pixels: UInt8[np.ndarray, "height width 3"],
    hands: Mapping[int, DrawnHand],
    faces: Int[np.ndarray, "face 3"],
    layout: ClipLayout,
    caption: str = "",
) -> UInt8[np.ndarray, "drawn_height drawn_width 3"]:
    """Draw the hands of one frame; the drawing has the same size for all frames of a clip.

    Args:
        pixels: The frame, RGB.
        hands: Its hands by their numbers.
        faces: Triangles of the mesh, in either winding.
        layout: The panels beside it.
        caption: Text below the panels, such as the time; on the frame if there are none.
    """
    canvas = draw_hands(pixels, list(hands.values()), faces, CLIP_STYLE)
    height, width, _ = canvas.shape
    if not layout.shown:
        if caption:
            _put(canvas, text_strip(caption, _TEXT), height, 0)
        return canvas
    side = int(np.clip(height // len(layout.shown) - _TEXT, *_PANEL))
    tall = max(height, side * len(layout.shown))
    sheet = np.full((tall, width + side, 3), 255, dtype=np.uint8)
    sheet[:height, :width] = canvas
    for index, number in enumerate(layout.shown):
        panel = _panel(layout.titles[number], hands.get(number), faces, side)
        sheet[index * side : (index + 1) * side, width:] = panel
    if caption:
        _put(sheet, text_strip(caption, _TEXT), tall, width)
    return sheet


def _panel(
    title: str, hand: DrawnHand | None, faces: Int[np.ndarray, "face 3"], side: int
) -> Canvas:
    """One hand from the side under its title; the title alone where the hand is not in the frame."""
    panel = np.full((side, side, 3), 255, dtype=np.uint8)
    strip = text_strip(title if hand is not None else f"{title}: not seen", _TEXT)[:, :side]
    top, width, _ = strip.shape
    panel[:top, :width] = strip
    if hand is None:
        return panel
    room = side - top
    colour = HAND_COLOURS[hand.side]
    image = from_the_side(hand.vertices, faces, min(room, _LARGEST_RENDERED), colour)
    image = np.asarray(cv2.resize(image, (room, room), interpolation=cv2.INTER_CUBIC))
    panel[top:, top // 2 : top // 2 + room] = image
    return panel


def _put(sheet: Canvas, strip: UInt8[np.ndarray, "rows columns 3"], bottom: int, left: int) -> None:
    """Write a strip of text into the lower left corner of the panels."""
    strip = strip[:, : sheet.shape[1] - left]
    height, width, _ = strip.shape
    sheet[bottom - height : bottom, left : left + width] = strip
