"""Conversions between bend, splay and twist and rotations, about each joint's anatomical axes (Sec. 3.2).

Each joint has an orthonormal frame at rest: x along the child bone towards the wrist (twist), y dorsal
(splay), z the axis of flexion (bend). The rotation of the child segment from the anatomical neutral is
`R_y(splay) R_x(twist) R_z(bend)`. Twist, the axis with the least freedom, is in the middle, so the angles
lock only at ±90° of twist, which no joint reaches (decision 1).
"""

import torch
from jaxtyping import Float
from torch import Tensor


def angles_to_rotation(
    joint_angles: Float[Tensor, "*batch axis=3"],
) -> Float[Tensor, "*batch 3 3"]:
    """Rotation of the child segment from its anatomical neutral, in the joint's own frame.

    Args:
        joint_angles: Bend, splay and twist, radians.
    """
    # Bend is about z, splay about y, twist about x.
    cos_z, cos_y, cos_x = joint_angles.cos().unbind(-1)
    sin_z, sin_y, sin_x = joint_angles.sin().unbind(-1)
    sin_yx, cos_y_sin_x = sin_y * sin_x, cos_y * sin_x
    rows = [
        cos_y * cos_z + sin_yx * sin_z, sin_yx * cos_z - cos_y * sin_z, sin_y * cos_x,
        cos_x * sin_z, cos_x * cos_z, -sin_x,
        cos_y_sin_x * sin_z - sin_y * cos_z, sin_y * sin_z + cos_y_sin_x * cos_z, cos_y * cos_x,
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def rotation_to_angles(rotation: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch axis=3"]:
    """Inverse of `angles_to_rotation`, with twist in [−90°, 90°].

    Returns:
        Bend, splay and twist, radians.
    """
    twist = torch.atan2(-rotation[..., 1, 2], rotation[..., 1, :2].norm(dim=-1))
    bend = torch.atan2(rotation[..., 1, 0], rotation[..., 1, 1])
    splay = torch.atan2(rotation[..., 0, 2], rotation[..., 2, 2])
    return torch.stack([bend, splay, twist], dim=-1)


def joint_rotations(
    joint_angles: Float[Tensor, "*batch joint=15 axis=3"],
    frames: Float[Tensor, "joint=15 3 3"],
    rest_angles: Float[Tensor, "joint=15 axis=3"],
) -> Float[Tensor, "*batch joint=15 3 3"]:
    """Rotation of each joint from the rest pose, in the hand's own axes.

    Args:
        joint_angles: From the anatomical neutral, radians.
        frames: Axes of each child segment at rest, one per column, in the hand's frame.
        rest_angles: Joint angles of the rest pose, radians. They make zero joint angles the neutral pose,
            independent of the pose in which the mesh was modelled.
    """
    to_neutral = frames @ angles_to_rotation(rest_angles).mT
    return to_neutral @ angles_to_rotation(joint_angles) @ frames.mT


def joint_angles_of(
    rotations: Float[Tensor, "*batch joint=15 3 3"],
    frames: Float[Tensor, "joint=15 3 3"],
    rest_angles: Float[Tensor, "joint=15 axis=3"],
) -> Float[Tensor, "*batch joint=15 axis=3"]:
    """Joint angles from rotations, the inverse of `joint_rotations`."""
    return rotation_to_angles(angles_to_rotation(rest_angles) @ (frames.mT @ rotations @ frames))
