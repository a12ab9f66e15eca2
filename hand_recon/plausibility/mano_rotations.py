"""Joint angles out of MANO's rotations as other systems write them (docs/audit.md)."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.anatomical_frame import joint_angles_of
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.schema import HandParameters

_FINGER_JOINTS = [i for i, joint in enumerate(ARTICULATED) if not joint.startswith("thumb")]


@dataclass(frozen=True)
class ManoPose:
    """MANO's pose and shape of some hands; NaN for frames without a hand."""

    rotations: Float[Tensor, "hand joint=15 3 3"]
    """Rotation of each joint from MANO's flat rest pose, in MANO's order of joints."""
    shape: Float[Tensor, "hand direction=10"]
    """Coefficients of the shape directions, standard deviations; zero if they are not given."""
    global_rotation: Float[Tensor, "hand 3 3"]
    """Rotation of the whole hand; the unit matrix if it is not given."""


def to_rotations(pose: Float[Tensor, "hand ..."]) -> Float[Tensor, "hand joint 3 3"]:
    """Rotation matrices of joints, out of matrices or axis angles.

    Args:
        pose: Joint × 3 × 3 matrices, joint × 3 axis angles or all axis angles in a row, radians.

    Raises:
        ValueError: The numbers are none of these.
    """
    if pose.ndim == 4 and pose.shape[2:] == (3, 3):
        return pose
    flat = pose.flatten(1)
    if flat.shape[1] % 3:
        raise ValueError(
            f"A pose of the shape {tuple(pose.shape[1:])} was found; expected rotation matrices (joint, 3, "
            "3) or axis angles (joint, 3)."
        )
    return axis_angle_to_rotation(flat.unflatten(1, (-1, 3)))


def mirrored(rotations: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotations mirrored at x = 0, which exchanges left and right hands.

    Args:
        rotations: Rotation matrices.
    """
    mirror = torch.tensor([-1.0, 1.0, 1.0]).to(rotations)
    return mirror[:, None] * rotations * mirror


def to_parameters(pose: ManoPose, hand: HandModel) -> tuple[HandParameters, Bool[Tensor, ""]]:
    """Joint angles of right hands, and a flag that is true if the rotations were those of left hands.

    Systems that mirror the crops of left hands keep the rotations of the right hand that they see; others
    mirror the rotations back. A left hand's rotations, read as a right one's, bend the fingers backwards, so
    that the reading with more flexion in the mean of all hands is taken.

    Args:
        pose: Hands of one side of one file.
        hand: MANO's right hand.
    """
    candidates = [
        joint_angles_of(rotations, hand.frames, hand.rest_angles)
        for rotations in (pose.rotations, mirrored(pose.rotations))
    ]
    bends = [angles[:, _FINGER_JOINTS, AXES.index("bend")].nanmean() for angles in candidates]
    turned = bends[1] > bends[0]
    rotation = mirrored(pose.global_rotation) if bool(turned) else pose.global_rotation
    angles = candidates[int(turned)]
    # Where the hand is does not matter for an audit, and MANO's translation is not the origin's position.
    origin = torch.zeros(len(angles), 3).masked_fill(
        ~angles.isfinite().flatten(1).all(1)[:, None], torch.nan
    )
    return HandParameters(angles, pose.shape, rotation, origin), turned
