"""Images of the user's own MANO for FreiHAND's layout, with valid entries of `training_mano.json`.

Natural gestures are converted to FreiHAND's 61 numbers; images and 3D points are computed from these numbers.
Hands are drawn by painting triangles from back to front, which takes milliseconds.
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
class ManoImage:
    """One image with its ground truth; names as in `SyntheticHand`."""

    image: UInt8[np.ndarray, "height width 3"]
    """RGB."""
    mask: Bool[np.ndarray, "height width"]
    """True for pixels that show the hand."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels."""
    landmarks_3d: Float[np.ndarray, "landmark=21 3"]
    """Camera frame, metres."""
    vertices: Float[np.ndarray, "vertex 3"]
    """Camera frame, metres."""
    label: Float[np.ndarray, "1 number=61"]
    """Entry of `training_mano.json`."""


def mano_image(layer: ManoLayer, recipe: Recipe, index: int, appearance: int) -> ManoImage:
    """Generate one image; the result depends on the arguments only.

    Args:
        layer: MANO's right hand with the landmark set `mano`.
        recipe: Split, camera and size of the hand.
        index: Index of the hand.
        appearance: Index of the background; others show the same hand.
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
    return ManoImage(image, mask > 0, intrinsics, landmarks, vertices, label[None])


def _label(
    random: np.random.Generator, layer: ManoLayer, recipe: Recipe
) -> tuple[Float[np.ndarray, " number=61"], Float[np.ndarray, "3 3"]]:
    """Draw a hand in FreiHAND's numbers, and its camera matrix."""
    level, size = recipe.level, recipe.crop_size
    axis = random.normal(size=3)
    rotation = axis / np.linalg.norm(axis) * random.uniform(0, np.pi)
    model = layer.hand
    angles = torch.from_numpy(sample_pose(random, held_out=recipe.held_out)).to(model.frames)
    axis_angles = rotation_to_axis_angle(joint_rotations(angles, model.frames, model.rest_angles))
    residual = (axis_angles.flatten() - layer.hands_mean).numpy()
    shape = np.clip(random.normal(scale=0.7, size=10), -2, 2)
    pixel = size / 2 + random.uniform(-0.03, 0.03, size=2) * size
    # 0.1 m, about the distance from the middle MCP to the tips, spans the level's share of the image.
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
    # OpenCV takes sixteenths of a pixel, measured from pixel centres.
    pixels = np.round((projected - 0.5) * 16).astype(np.int32)
    for face in np.argsort(-corners[..., 2].mean(axis=1)).tolist():
        cv2.fillConvexPoly(image, pixels[face], colours[face], shift=4)
        cv2.fillConvexPoly(mask, pixels[face], (255,), shift=4)
