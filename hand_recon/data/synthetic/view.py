"""Random viewpoints and intrinsics, with a translation that makes the hand fill the crop."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.camera import REFERENCE_SIZE, project_array
from hand_recon.data.synthetic.levels import Level, Range

FACING: Final = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from hand to camera with the palm towards the camera and the fingers up."""

_FOREARM_TO_CAMERA: Final = -0.6
"""Least depth component of the unit vector to the elbow."""


@dataclass(frozen=True)
class View:
    """Rotation, translation and camera matrix of one view."""

    root_rotation: Float[np.ndarray, "3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[np.ndarray, " 3"]
    """Position of the hand's origin in the camera's frame, metres."""
    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels of the crop."""

    def to_camera(self, points: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 3"]:
        """Transform points from the hand's frame to the camera's, metres."""
        return points @ self.root_rotation.T + self.translation


def sample_view(
    random: np.random.Generator,
    level: Level,
    crop_size: int,
    landmarks: Float[np.ndarray, "landmark=21 3"],
) -> View:
    """Draw a view of the level in which the landmarks' bounding square has the drawn size and offset.

    Args:
        random: Source of randomness.
        level: Level with the ranges of viewpoint, roll, camera, fill and offset.
        crop_size: Side of the image, pixels.
        landmarks: Hand's frame, metres.
    """
    rotation = sample_rotation(random, level)
    intrinsics = _sample_intrinsics(random, level, crop_size)
    side = random.uniform(*level.fill) * crop_size
    far = random.random() < level.truncation
    reach = random.uniform(0.2, 0.38) if far else level.shift
    direction = random.uniform(-1, 1, size=2)
    if far:
        direction /= np.abs(direction).max()
    centre = crop_size * (0.5 + reach * direction)
    return View(rotation, _fit(landmarks @ rotation.T, intrinsics, centre, side), intrinsics)


def sample_rotation(random: np.random.Generator, level: Level) -> Float[np.ndarray, "3 3"]:
    """Draw a viewpoint uniformly within the level's cone, then a roll.

    Viewpoints from which the forearm points at the camera and hides the hand are left out.
    """
    rotation = _any_rotation(random, level)
    while rotation[2, 0] < _FOREARM_TO_CAMERA:
        rotation = _any_rotation(random, level)
    return rotation


def _any_rotation(random: np.random.Generator, level: Level) -> Float[np.ndarray, "3 3"]:
    smallest = np.cos(np.radians(level.cone))
    tilt = np.arccos(random.uniform(smallest, 1.0))
    heading = random.uniform(0, 2 * np.pi)
    roll = np.radians(random.uniform(-level.roll, level.roll))
    tilted = axis_rotation(np.array([np.cos(heading), np.sin(heading), 0.0]), tilt)
    return axis_rotation(np.array([0.0, 0.0, 1.0]), roll) @ tilted @ FACING


def axis_rotation(axis: Float[np.ndarray, " 3"], angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew)


def _sample_intrinsics(
    random: np.random.Generator, level: Level, crop_size: int
) -> Float[np.ndarray, "3 3"]:
    def draw(bounds: Range) -> float:
        return float(random.uniform(*bounds)) * crop_size / REFERENCE_SIZE

    focal, centre_x, centre_y = draw(level.focal), draw(level.principal_x), draw(level.principal_y)
    return np.array([[focal, 0, centre_x], [0, focal, centre_y], [0, 0, 1.0]])


def _fit(
    points: Float[np.ndarray, "point 3"],
    intrinsics: Float[np.ndarray, "3 3"],
    centre: Float[np.ndarray, " 2"],
    side: float,
) -> Float[np.ndarray, " 3"]:
    """Translation, metres, at which the projected bounding square has this centre and side, pixels."""
    focal = intrinsics[0, 0]
    extent = float(np.ptp(points[:, :2], axis=0).max())
    translation = np.array([0.0, 0.0, focal * extent / side])
    for _ in range(8):
        translation[2] = max(translation[2], 0.08 - points[:, 2].min())
        pixels = project_array(points + translation, intrinsics)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        missed = centre - (low + high) / 2
        translation[:2] += missed * translation[2] / focal
        translation *= float((high - low).max()) / side
    return translation
