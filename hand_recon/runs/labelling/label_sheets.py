"""Pages of labelled hands to look at: sure ones spread evenly, and doubtful ones with their marks."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import UInt8

from hand_recon.data.images import read_image
from hand_recon.data.selection import evenly_spaced
from hand_recon.runs.labelling.label_files import Pair
from hand_recon.runs.labelling.label_records import LabelledHand
from hand_recon.visualization.canvas import Panel, sheet
from hand_recon.visualization.overlay import draw_landmarks

PANEL: Final = 256
"""Side of a hand's panel, pixels."""

GRID: Final = (4, 6)
"""Rows and columns of a page."""

AROUND: Final = 1.7
"""Side of a panel's square, in extents of the hand."""

CHARACTERS: Final = 34
"""Characters in a line of a panel."""

_LINE: Final = 18

Image = UInt8[np.ndarray, "height width 3"]


def draw_sheets(folder: Path, root: Path, pairs: Sequence[Pair], most: int) -> list[Path]:
    """Write pages of sure and of doubtful hands, `sure_1.png`, `doubtful_1.png` and so on.

    Doubtful hands are in the order of their marks, so that like is beside like. Images that cannot be read
    any more are left out.

    Args:
        folder: Folder of the pages, which is made.
        root: Folder of the images.
        pairs: All hands.
        most: Most hands of each kind.

    Returns:
        The pages.
    """
    sure = [pair for pair in pairs if pair[1].is_sure]
    doubtful = sorted(
        (pair for pair in pairs if not pair[1].is_sure), key=lambda pair: list(pair[1].reasons)
    )
    pages = []
    for name, some in (("sure", sure), ("doubtful", doubtful)):
        chosen = [some[position] for position in evenly_spaced(len(some), most)]
        panels = [panel for pair in chosen if (panel := _panel(root, pair)) is not None]
        size = GRID[0] * GRID[1]
        for number, start in enumerate(range(0, len(panels), size), start=1):
            folder.mkdir(exist_ok=True)
            path = folder / f"{name}_{number}.png"
            cv2.imwrite(str(path), _page(panels[start : start + size])[..., ::-1])
            pages.append(path)
    return pages


def _page(panels: Sequence[Panel]) -> UInt8[np.ndarray, "height width 3"]:
    columns = min(GRID[1], len(panels))
    cells: list[Panel | None] = [*panels, *[None] * (-len(panels) % columns)]
    return sheet([cells[start : start + columns] for start in range(0, len(cells), columns)])


def _panel(root: Path, pair: Pair) -> Panel | None:
    image, hand = pair
    pixels = read_image(root / image.name)
    if pixels is None:
        return None
    score = "" if hand.score is None else f"  {hand.score:.2f}"
    drawn = _with_text(labelled_crop(pixels, hand, PANEL), list(hand.reasons))
    return Panel(drawn, f"{image.name[-20:]}  {hand.side}{score}")


def labelled_crop(
    pixels: Image, hand: LabelledHand, side: int
) -> UInt8[np.ndarray, "{side} {side} 3"]:
    """The square around a hand with its landmarks drawn; grey outside of the image.

    Args:
        pixels: RGB.
        hand: The hand.
        side: Side of the result, pixels.
    """
    points = hand.landmarks_2d
    middle = (hand.box[:2] + hand.box[2:]) / 2
    scale = side / max(AROUND * hand.extent, 1.0)
    matrix = np.array([[scale, 0, 0], [0, scale, 0]], dtype=np.float64)
    matrix[:, 2] = side / 2 - scale * middle
    # OpenCV counts from pixel centres.
    centres = matrix.copy()
    centres[:, 2] += 0.5 * scale - 0.5
    crop = cv2.warpAffine(
        pixels, centres, (side, side), flags=cv2.INTER_LINEAR, borderValue=(128, 128, 128)
    )
    return draw_landmarks(np.asarray(crop, dtype=np.uint8), points * scale + matrix[:, 2])


def _with_text(panel: Image, marks: Sequence[str]) -> Image:
    """The panel with the names of marks written at its top."""
    lines = textwrap.wrap("; ".join(marks), CHARACTERS)
    drawn = panel.copy()
    drawn[: _LINE * len(lines)] = 255
    for number, line in enumerate(lines, start=1):
        place = (3, _LINE * number - 5)
        cv2.putText(drawn, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.43, (200, 0, 0), 1, cv2.LINE_AA)
    return drawn
