"""Images of hands fitted to 2D landmarks: given and fitted landmarks, the mesh, and a contact sheet."""

import logging
import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from hand_recon.data.crop import around_landmarks, crop_image, crop_matrix, crop_points
from hand_recon.data.images import read_image
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.rendering.mesh import from_the_side, shade
from hand_recon.visualization.overlay import draw_landmarks

logger = logging.getLogger(__name__)

PANELS: Final = ("given landmarks", "fitted landmarks", "fitted mesh", "from the side")
"""Titles of the panels of a row."""

ROWS_PER_COLUMN: Final = 8
"""Most rows of a contact sheet's column."""

_MARGIN: Final = 1.4
_CAPTION: Final = 18
_PALE: Final = 245


@dataclass(frozen=True)
class FittedImage:
    """One hand with its given and fitted landmarks and its mesh, left hands as left hands."""

    caption: str
    """Caption of the row."""
    given: Float[np.ndarray, "landmark=21 2"]
    """Given landmarks, pixels of the image; NaN where there is none."""
    found: Float[np.ndarray, "landmark=21 2"]
    """Projected landmarks of the fitted hand, pixels of the image."""
    vertices: Float[np.ndarray, "vertex 3"]
    """Vertices of the fitted mesh, camera frame, metres."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix of the image, pixels."""
    image: UInt8[np.ndarray, "height width 3"] | None = None
    """Background, RGB; None for white."""


def fitted_image(part: FittedHands, position: int, number: int) -> FittedImage:
    """Collect what is drawn of a hand; an image that cannot be read becomes white, with a warning.

    Args:
        part: The part that the hand belongs to.
        position: Index of the hand in the part.
        number: Index of the hand among all hands.
    """
    observed, found = part.observed, part.prediction
    file = observed.images[position]
    image = None if file is None else read_image(file)
    if file is not None and image is None:
        logger.warning("Cannot read %s: hand %d is drawn on white.", file, number)
    side = "left" if bool(observed.left[position]) else "right"
    residual = float(part.distance[position].nanmean())
    return FittedImage(
        caption=row_caption(number, observed.names[position], side, residual),
        given=observed.landmarks_2d[position].numpy(),
        found=found.landmarks_2d[position].double().numpy(),
        vertices=found.vertices[position].double().numpy(),
        intrinsics=found.intrinsics[position].double().numpy(),
        image=image,
    )


def row_caption(number: int, name: str, side: str, residual: float) -> str:
    """Caption of the row of a hand.

    Args:
        number: Index of the hand among all hands.
        name: Its name.
        side: `left` or `right`.
        residual: Mean distance to the given landmarks, pixels of the image.
    """
    return f"{number}: {name}, {side}, {residual:.1f} px"


def draw_fitted(
    hand: FittedImage, faces: Int[np.ndarray, "face 3"], panel: int = 224
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the row of one hand: `PANELS`, cropped from the image about the hand.

    Args:
        hand: The hand.
        faces: Triangles of the mesh, in either winding.
        panel: Side of each panel, pixels.
    """
    both = np.concatenate([hand.given, hand.found])
    matrix = crop_matrix(around_landmarks(both, _MARGIN), panel)
    if hand.image is None:
        background = np.full((panel, panel, 3), 255, dtype=np.uint8)
    else:
        background = crop_image(hand.image, matrix, panel)
    mesh = shade(hand.vertices, faces, matrix @ hand.intrinsics, panel)
    return np.concatenate(
        [
            draw_landmarks(background, crop_points(hand.given, matrix)),
            draw_landmarks(background, crop_points(hand.found, matrix)),
            draw_landmarks(mesh.over(background, opacity=0.8), crop_points(hand.given, matrix)),
            from_the_side(hand.vertices, faces, panel),
        ],
        axis=1,
    )


def contact_sheet(
    rows: list[UInt8[np.ndarray, "height width 3"]], captions: list[str]
) -> UInt8[np.ndarray, "sheet_height sheet_width 3"]:
    """Stack rows of one size in columns, each row below its caption, `PANELS` above each column.

    Raises:
        ValueError: There is no row.
    """
    if not rows:
        raise ValueError(
            "Found no row for the contact sheet; expected one or more. Draw a hand first."
        )
    _, width, _ = rows[0].shape
    strips = [
        np.concatenate([_text(caption, width), row])
        for row, caption in zip(rows, captions, strict=True)
    ]
    panel = width // len(PANELS)
    titles = np.concatenate([_text(title, panel) for title in PANELS], axis=1)
    height = math.ceil(len(strips) / math.ceil(len(strips) / ROWS_PER_COLUMN))
    blank = np.full_like(strips[0], 255)
    columns = []
    for start in range(0, len(strips), height):
        column = strips[start : start + height]
        columns.append(np.concatenate([titles, *column, *[blank] * (height - len(column))]))
    return np.concatenate(columns, axis=1)


def _text(words: str, width: int) -> UInt8[np.ndarray, "height width 3"]:
    strip = np.full((_CAPTION, width, 3), _PALE, dtype=np.uint8)
    # OpenCV's fonts have only ASCII letters.
    letters = words.encode("ascii", "replace").decode("ascii")
    cv2.putText(
        strip, letters, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (20, 20, 20), 1, cv2.LINE_AA
    )
    return strip
