"""Contact sheet of training samples with their labels drawn on them."""

from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Int, UInt8

from hand_recon.rendering.mesh import shade
from hand_recon.schema import HandBatch
from hand_recon.visualization.canvas import Panel, background, sheet
from hand_recon.visualization.overlay import draw_landmarks

PANEL: Final = 224
"""Side of a sample on the page, pixels."""

COLUMNS: Final = 6
"""Samples and surfaces in a row of the page."""

_BOX: Final = (255, 120, 0)


def contact_sheet(
    batch: HandBatch, faces: Int[torch.Tensor, "face 3"]
) -> UInt8[np.ndarray, "sheet_height sheet_width 3"]:
    """Draw each sample with its landmarks and their bounding box, and beside it its labelled surface.

    Args:
        batch: Images as bytes, right hands.
        faces: Triangles of the labelled surfaces.
    """
    panels: list[Panel | None] = []
    for index in range(len(batch)):
        side = "left, mirrored" if batch.mirrored is not None and batch.mirrored[index] else "right"
        caption = f"{batch.source[index][-30:]}  {side}"
        panels.append(Panel(_labelled(batch, index), caption))
        surface = _with_surface(batch, index, faces)
        if surface is not None:
            panels.append(Panel(surface, "surface"))
    panels += [None] * (-len(panels) % COLUMNS)
    grid = [panels[start : start + COLUMNS] for start in range(0, len(panels), COLUMNS)]
    return sheet(grid)


def _labelled(batch: HandBatch, index: int) -> UInt8[np.ndarray, "height width 3"]:
    landmarks = (batch.landmarks_2d[index] * PANEL / batch.crop_size).double().numpy()
    shown = batch.labelled[index].numpy()
    canvas = draw_landmarks(background(batch.image[index], PANEL), landmarks, shown)
    if shown.any():
        low, high = landmarks[shown].min(axis=0), landmarks[shown].max(axis=0)
        corners = [tuple(int(value) for value in corner.round()) for corner in (low, high)]
        cv2.rectangle(canvas, corners[0], corners[1], _BOX, 1, cv2.LINE_AA)
    return canvas


def _with_surface(
    batch: HandBatch, index: int, faces: Int[torch.Tensor, "face 3"]
) -> UInt8[np.ndarray, "height width 3"] | None:
    if batch.vertices is None or batch.intrinsics is None:
        return None
    vertices = batch.vertices[index].double()
    if not vertices.isfinite().all() or int(faces.max()) >= len(vertices):
        return None
    camera = batch.intrinsics[index].double().numpy().copy()
    camera[:2] *= PANEL / batch.crop_size
    image = background(batch.image[index], PANEL)
    return shade(vertices.numpy(), faces.numpy(), camera, PANEL).over(image, opacity=0.8)
