"""Test images with the predicted landmarks, the mesh on the image, and the mesh from the side."""

from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8

from hand_recon.hand.skeleton import LANDMARK_PARENTS
from hand_recon.rendering.mesh import from_the_side, shade
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization.canvas import background

FINGER_COLOURS: Final = (
    (30, 30, 30), (240, 190, 20), (40, 160, 70), (50, 100, 220), (205, 50, 160),
)  # fmt: skip
"""RGB colours of the fingers, as in the paper's Fig. 4: thumb black, index yellow, middle green, ring blue,
little magenta."""

COLUMNS: Final = ("image and labels", "predicted landmarks", "mesh on the image", "from the side")
"""Titles of the panels of a row."""


def draw_landmarks(
    image: UInt8[np.ndarray, "height width 3"],
    landmarks: Float[np.ndarray, "landmark=21 2"],
    shown: Bool[np.ndarray, "landmark=21"] | None = None,
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw the skeleton on a copy of an image, one colour per finger.

    Args:
        image: RGB.
        landmarks: Pixels, pixel i covering [i, i + 1).
        shown: Mask of the landmarks to draw; without it, all that are finite.
    """
    finite = np.isfinite(landmarks).all(axis=1)
    shown = finite if shown is None else shown & finite
    canvas = np.ascontiguousarray(image.copy())
    # OpenCV's pixel centres are at whole numbers; coordinates are in 1/16 pixel.
    fixed = np.where(finite[:, None], (landmarks - 0.5) * 16, 0).clip(-(2**20), 2**20)
    points = [tuple(int(value) for value in point) for point in fixed.round()]
    width = max(1, image.shape[0] // 110)
    for child, parent in enumerate(LANDMARK_PARENTS):
        colour = FINGER_COLOURS[max(child - 1, 0) // 4]
        if parent >= 0 and shown[child] and shown[parent]:
            cv2.line(canvas, points[parent], points[child], colour, width, cv2.LINE_AA, 4)
    for child in np.flatnonzero(shown).tolist():
        colour = FINGER_COLOURS[max(child - 1, 0) // 4]
        cv2.circle(canvas, points[child], (width + 1) * 16, (255, 255, 255), -1, cv2.LINE_AA, 4)
        cv2.circle(canvas, points[child], (width + 1) * 16 - 8, colour, -1, cv2.LINE_AA, 4)
    return canvas


def rows(
    batch: HandBatch,
    prediction: HandPrediction,
    faces: Int[torch.Tensor, "face 3"],
    panel: int = 224,
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Draw one row per hand of a batch, with the panels of `COLUMNS`.

    Args:
        batch: Images as bytes, or as floats 0–1, with their labels.
        prediction: Predictions for these images.
        faces: Triangles of the hand.
        panel: Side of each panel, pixels.
    """
    scale = panel / batch.crop_size
    cameras = prediction.intrinsics.double().cpu().numpy().copy()
    cameras[:, :2] *= scale
    triangles = faces.cpu().numpy()
    drawn = []
    for index in range(len(batch)):
        image = background(batch.image[index], panel)
        labels = (batch.landmarks_2d[index] * scale).cpu().numpy()
        landmarks = (prediction.landmarks_2d[index] * scale).cpu().numpy()
        vertices = prediction.vertices[index].double().cpu().numpy()
        mesh = shade(vertices, triangles, cameras[index], panel).over(image, opacity=0.8)
        drawn.append(
            np.concatenate(
                [
                    draw_landmarks(image, labels, batch.labelled[index].cpu().numpy()),
                    draw_landmarks(image, landmarks),
                    mesh,
                    from_the_side(vertices, triangles, panel),
                ],
                axis=1,
            )
        )
    return drawn
