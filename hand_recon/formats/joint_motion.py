"""Skeleton, skin and motion of a hand as formats of animation need them: its own side, y up, metres.

The hand's frame has its fingers along −x, its palm towards −y and its thumb at +z (a left hand: fingers along
+x). In a world with y up that is how the hand lies on a figure with outstretched arms that faces +z. The
world's axes are glTF's: the camera's with y and z reversed, so that a viewer shows what the camera saw.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation
from torch import Tensor

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory, mirror_of
from hand_recon.rendering.mesh_files import CAMERA_TO_GLTF

SINGLE_FRAME: Final = 1 / 30
"""Seconds for which a frame is shown where no second one says its rate."""

_TO_WORLD: Final = np.array(CAMERA_TO_GLTF)


@dataclass(frozen=True)
class Rig:
    """Surface, skeleton and skin of a hand of one shape and its own side, in the pose that was modelled."""

    vertices: Float[np.ndarray, "vertex 3"]
    """Hand's frame, metres."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles, anticlockwise from outside."""
    joints: Float[np.ndarray, "joint=16 3"]
    """Rotation centres, hand's frame, metres."""
    weights: Float[np.ndarray, "vertex joint=16"]
    """Share of each joint's motion in each vertex; rows sum to one."""


@dataclass(frozen=True)
class JointMotion:
    """Rotations of all joints and positions of the wrist, in a world with y up."""

    rotations: Float[np.ndarray, "frame joint=16 3 3"]
    """Rotation of each joint relative to its parent, from the pose at rest, in the hand's axes; the wrist's
    leads from the hand's axes to the world's."""
    wrist: Float[np.ndarray, "frame 3"]
    """Position of the wrist in the world, metres."""


def check_motions(trajectories: Sequence[Trajectory]) -> None:
    """Check that there are hands to write, each with frames of finite numbers at times from zero.

    Raises:
        ValueError: There is no hand, a hand has no frame, a number is not finite, or a time is negative.
    """
    if not trajectories:
        raise ValueError("Found no hand to write; expected one or more. Leave the file out.")
    for trajectory in trajectories:
        if not len(trajectory):
            raise ValueError(
                f"Hand {trajectory.hand} has no frame; expected one or more. Leave the hand out."
            )
        numbers = (
            trajectory.times, trajectory.joint_angles, trajectory.root_rotation,
            trajectory.translation, trajectory.shape,
        )  # fmt: skip
        if not all(np.isfinite(values).all() for values in numbers):
            raise ValueError(
                f"Hand {trajectory.hand} has numbers that are not finite; expected a pose for each of its "
                "frames. Bridge its gaps, or leave the hand out."
            )
        if trajectory.times[0] < 0:
            raise ValueError(
                f"Hand {trajectory.hand} begins at {trajectory.times[0]:g} s; expected times from the clip's "
                "start, from 0. Subtract the time of the clip's first frame from all hands."
            )


def rig_of(trajectory: Trajectory, hand: HandModel) -> Rig:
    """Make the rig of a trajectory's shape and side.

    Args:
        trajectory: The hand.
        hand: Model of the right hand.
    """
    vertices, joints = hand.rest(_like(trajectory.shape, hand))
    mirror, faces = mirror_of(trajectory.side), hand.faces.cpu().numpy()
    return Rig(
        _numpy(vertices) * mirror,
        # The mirror image of a triangle runs the other way round.
        np.ascontiguousarray(faces[:, ::-1]) if trajectory.side == "left" else faces,
        _numpy(joints) * mirror,
        _numpy(hand.skinning_weights),
    )


def motion_of(trajectory: Trajectory, hand: HandModel) -> JointMotion:
    """Compute the motion of the joints of `rig_of`.

    Args:
        trajectory: The hand, with at least one frame.
        hand: Model of the right hand.
    """
    mirror = mirror_of(trajectory.side)
    fingers = local_rotations(_like(trajectory.joint_angles, hand), hand)
    root = _TO_WORLD[:, None] * trajectory.root_rotation.astype(np.float64)
    wrist = rig_of(trajectory, hand).joints[0]
    return JointMotion(
        np.concatenate([root[:, None], fingers * np.outer(mirror, mirror)], axis=1),
        root @ wrist + trajectory.translation * _TO_WORLD,
    )


def local_rotations(
    joint_angles: Float[Tensor, "*batch joint=15 axis=3"], hand: HandModel
) -> Float[np.ndarray, "*batch joint=15 3 3"]:
    """Rotation of each joint of a right hand relative to its parent, from the pose at rest, hand's axes."""
    return _numpy(joint_rotations(joint_angles, hand.frames, hand.rest_angles))


def to_quaternions(
    rotations: Float[np.ndarray, "frame joint 3 3"],
) -> Float[np.ndarray, "frame joint quaternion=4"]:
    """Convert rotations to unit quaternions (x, y, z, w), neighbouring frames in one hemisphere.

    Of the two quaternions of a rotation each frame has the one nearer to the frame before, so that an
    interpolation takes the short way round.
    """
    flat = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat()
    quaternions = flat.reshape(*rotations.shape[:2], 4)
    products = (quaternions[1:] * quaternions[:-1]).sum(axis=-1)
    signs = np.where(products < 0, -1.0, 1.0).cumprod(axis=0)
    quaternions[1:] *= signs[..., None]
    return quaternions


def _like(values: Float[np.ndarray, "..."], hand: HandModel) -> Tensor:
    return torch.as_tensor(values).to(hand.template)


def _numpy(tensor: Tensor) -> Float[np.ndarray, "..."]:
    return tensor.detach().cpu().numpy().astype(np.float64)
