"""A page of photographs with the hands of each method, from the camera and from the side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import UInt8

from hand_recon.data.selection import evenly_spaced
from hand_recon.fitting.results import write_image
from hand_recon.hand.open_hand import open_hand
from hand_recon.rendering.mesh import from_the_side, shade
from hand_recon.visualization.canvas import background
from hand_recon.visualization.overlay import draw_landmarks
from photos.scores import Scored

PHOTOGRAPHS: Final = 60
"""Photographs on a page."""

PER_LINE: Final = 6
"""Photographs in a line of the page."""

SIDE: Final = 136
"""Side of each image on the page, pixels."""

Image = UInt8[np.ndarray, "height width 3"]


def page(scored: Sequence[Scored], photographs: int = PHOTOGRAPHS) -> Image:
    """Draw photographs with their labels, and below each every method's hand, over it and from the side.

    Args:
        scored: Methods; those on other photographs than the first are left out.
        photographs: Number of photographs, spread evenly over the set; whole lines of `PER_LINE` are drawn.
    """
    methods = [one for one in scored if one.hands is scored[0].hands]
    rows = evenly_spaced(len(methods[0].hands), photographs)
    cells = [_cell(methods, row) for row in rows]
    lines = [
        np.concatenate(cells[start : start + PER_LINE], axis=1)
        for start in range(0, len(cells) - PER_LINE + 1, PER_LINE)
    ]
    return np.concatenate(lines)


def draw_page(path: Path, scored: Sequence[Scored]) -> None:
    """Write a page of photographs.

    Args:
        path: A PNG file.
        scored: As for `page`.
    """
    write_image(path, page(scored))


def _cell(methods: Sequence[Scored], row: int) -> Image:
    """A photograph with its labels, and below it each method's two views."""
    batch = methods[0].hands.batch
    scale = SIDE / batch.crop_size
    image = background(batch.image[row], SIDE)
    labels = (batch.landmarks_2d[row] * scale).numpy()
    lines = [[image, draw_landmarks(image, labels, batch.labelled[row].numpy())]]
    faces = open_hand().faces.numpy()
    for one in methods:
        camera = one.prediction.intrinsics[row].double().numpy().copy()
        # A fit's camera is that of a crop of 224 pixels: its principal point tells the crop's side.
        camera[:2] *= SIDE / (2 * camera[0, 2])
        vertices = one.prediction.vertices[row].double().numpy()
        over = shade(vertices, faces, camera, SIDE).over(image, opacity=0.8)
        lines.append([over, from_the_side(vertices, faces, SIDE)])
    return np.concatenate([np.concatenate(line, axis=1) for line in lines])
