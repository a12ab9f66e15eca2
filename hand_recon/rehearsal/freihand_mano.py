"""Hands of the user's own MANO for FreiHAND's layout, so that `training_mano.json` says what it means there.

Natural gestures are written in FreiHAND's 61 numbers, and what those numbers mean is what is drawn and
written as points: by painting triangles from back to front, which takes milliseconds.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from hand_recon.camera import project_array
from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.data.synthetic.recipe import Recipe
from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.axis_angle import rotation_to_axis_angle
from hand_recon.hand.mano.labels import freihand_parameters
from hand_recon.hand.mano.layer import ManoLayer

_LIGHT: Final = np.array([0.3, -0.5, -0.81])


@dataclass(frozen=True)
class ManoPicture:
    """One picture and what is known of it; names as in `SyntheticHand`."""

    image: UInt8[np.ndarray, "height width 3"]
    mask: Bool[np.ndarray, "height width"]
    intrinsics: Float[np.ndarray, "3 3"]
    landmarks_3d: Float[np.ndarray, "landmark=21 3"]
    vertices: Float[np.ndarray, "vertex 3"]
    label: Float[np.ndarray, "1 number=61"]
    """An entry of `training_mano.json`."""


def mano_picture(layer: ManoLayer, recipe: Recipe, index: int, appearance: int) -> ManoPicture:
    """The picture of that index, the same wherever and whenever it is made.

    Args:
        layer: MANO's right hand with the landmark set `mano`.
        recipe: Its split, camera and size of the hand.
        index: Which hand.
        appearance: Other numbers give the same hand before another background.
    """
    random = recipe.random(index, "MANO hand")
    label, intrinsics = _label(random, layer, recipe)
    with torch.no_grad():
        numbers = (torch.from_numpy(array).float() for array in (label, intrinsics))
        hand = layer(*freihand_parameters(layer, *numbers))
    vertices, landmarks = (points.double().numpy() for points in (hand.vertices, hand.landmarks))
    backdrop = recipe.random(index, f"MANO background {appearance}").integers(30, 200, size=3)
    image = np.empty((recipe.crop_size, recipe.crop_size, 3), np.uint8)
    image[:] = backdrop
    mask = np.zeros(image.shape[:2], np.uint8)
    _paint(image, mask, vertices[layer.hand.faces.numpy()], intrinsics)
    return ManoPicture(image, mask > 0, intrinsics, landmarks, vertices, label[None])


def _label(
    random: np.random.Generator, layer: ManoLayer, recipe: Recipe
) -> tuple[Float[np.ndarray, " number=61"], Float[np.ndarray, "3 3"]]:
    """A hand in FreiHAND's numbers, and its camera."""
    level, size = recipe.level, recipe.crop_size
    axis = random.normal(size=3)
    rotation = axis / np.linalg.norm(axis) * random.uniform(0, np.pi)
    model = layer.hand
    angles = torch.from_numpy(sample_pose(random, held_out=recipe.held_out)).to(model.frames)
    turns = rotation_to_axis_angle(joint_rotations(angles, model.frames, model.rest_angles))
    residual = (turns.flatten() - layer.hands_mean).numpy()
    shape = np.clip(random.normal(scale=0.7, size=10), -2, 2)
    pixel = size / 2 + random.uniform(-0.03, 0.03, size=2) * size
    # A tenth of a metre, from the middle MCP to the tips, covers the level's share of the picture.
    scale = random.uniform(*level.fill) * size / 0.1
    focal = random.uniform(*level.focal)
    centre = random.uniform(*level.principal_x), random.uniform(*level.principal_y)
    intrinsics = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    return np.concatenate([rotation, residual, shape, pixel, [scale]]), intrinsics


def _paint(
    image: UInt8[np.ndarray, "height width 3"],
    mask: UInt8[np.ndarray, "height width"],
    corners: Float[np.ndarray, "face corner=3 3"],
    intrinsics: Float[np.ndarray, "3 3"],
) -> None:
    """Paint triangles from back to front, lit from above."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True) + 1e-12
    shade = 0.45 + 0.55 * np.abs(normals @ _LIGHT)
    colours = (shade[:, None] * [225, 170, 140]).astype(int).tolist()
    projected = project_array(corners, intrinsics)
    # Sixteenths of a pixel; OpenCV counts from pixel centres.
    pixels = np.round((projected - 0.5) * 16).astype(np.int32)
    for face in np.argsort(-corners[..., 2].mean(axis=1)).tolist():
        cv2.fillConvexPoly(image, pixels[face], colours[face], shift=4)
        cv2.fillConvexPoly(mask, pixels[face], (255,), shift=4)
