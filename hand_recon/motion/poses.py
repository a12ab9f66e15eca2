"""One pose of a hand in each frame, and rotations as a curve that linear methods apply to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Poses:
    """Pose of one hand in some frames. Left hands are mirrored to right hands, and the camera with them."""

    frames: Int[np.ndarray, " frame"]
    """Number of each frame in the clip, increasing."""
    times: Float[np.ndarray, " frame"]
    """Time of each frame, seconds, increasing."""
    joint_angles: Float[np.ndarray, "frame joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    root_rotation: Float[np.ndarray, "frame 3 3"]
    """Rotation from the hand's frame to the camera's."""
    place: Float[np.ndarray, "frame 3"]
    """Origin of the hand's frame: x / z, y / z, and the logarithm of z in metres."""
    certainty: Float[np.ndarray, " frame"]
    """Certainty of each pose, one for a typical hand; zero where the hand was not seen."""

    def __len__(self) -> int:
        return len(self.frames)


def coordinates_of(poses: Poses) -> Float[np.ndarray, "frame coordinate=51"]:
    """Joint angles, rotations as a curve, and places of poses.

    Args:
        poses: One pose or more.
    """
    curve = developed(poses.root_rotation)
    return np.concatenate([poses.joint_angles.reshape(-1, 45), curve, poses.place], axis=1)


def developed(rotation: Float[np.ndarray, "frame 3 3"]) -> Float[np.ndarray, "frame 3"]:
    """Curve of axis angles whose steps are those from each rotation to the next, in the camera's axes.

    It begins at zero and has no jumps at 180°, unlike the axis angles of the rotations. For a rotation about
    one axis it is the angle about that axis.

    Args:
        rotation: Rotations of one frame or more.
    """
    steps = axis_angle_between(rotation[:-1], rotation[1:])
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def axis_angle_between(
    before: Float[np.ndarray, "frame 3 3"], after: Float[np.ndarray, "frame 3 3"]
) -> Float[np.ndarray, "frame 3"]:
    """Axis angle of the rotation that is applied after one rotation to reach another, radians.

    Args:
        before: Rotations before.
        after: Rotations after.
    """
    if not len(before):
        return np.zeros((0, 3))
    return np.asarray(Rotation.from_matrix(after @ before.swapaxes(1, 2)).as_rotvec())


def rotated(
    rotation: Float[np.ndarray, "frame 3 3"], axis_angle: Float[np.ndarray, "frame 3"]
) -> Float[np.ndarray, "frame 3 3"]:
    """Rotations followed by further ones.

    Args:
        rotation: Rotations.
        axis_angle: Rotations that are applied after them, in the camera's axes, radians.
    """
    return np.asarray(Rotation.from_rotvec(axis_angle).as_matrix() @ rotation)
