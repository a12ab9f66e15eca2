"""Hand pose from 3D landmarks in closed form: the palm by rigid alignment, each finger bone by bone.

The direction of a bone in the axes of the bone before it gives bend and splay of the joint between them
(Sec. 3.2). Its twist moves no landmark of that bone and is taken as zero.
"""

from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.hand.anatomical_frame import angles_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARK_OF_JOINT, LANDMARKS, PARENTS

PALM: Final = tuple(
    LANDMARKS.index(name)
    for name in ("wrist", "thumb CMC", "index MCP", "middle MCP", "ring MCP", "little MCP")
)
"""Landmarks of the palm, which no joint angle moves."""

_LEAST_PALM: Final = 3


def start_of_points(hand: HandModel, points: Float[Tensor, "hand landmark=21 3"]) -> Unknowns:
    """Pose the mean hand so that its palm lies on the given one and its bones point as the given ones do.

    Args:
        hand: Hand model, in the landmark set of the points.
        points: Landmarks of right hands, metres; NaN where missing.

    Returns:
        Joint angles and root rotation; place zero, since points need no camera, and the mean shape.
    """
    rest = hand(hand.neutral_angles(), hand.template.new_zeros(10)).landmarks
    rotation = _palm_rotation(rest, points)
    angles = points.new_zeros(len(points), 15, 3)
    axes = {0: rotation}
    for joint, parent in enumerate(PARENTS):
        if joint == 0:
            continue
        before = axes[parent] @ _between(hand, joint)
        bone = points[:, LANDMARK_OF_JOINT[joint] + 1] - points[:, LANDMARK_OF_JOINT[joint]]
        angles[:, joint - 1] = _bend_and_splay((before.mT @ bone[..., None])[..., 0])
        axes[joint] = before @ angles_to_rotation(angles[:, joint - 1])
    return Unknowns(
        angles, rotation, points.new_zeros(len(points), 3), points.new_zeros(len(points), 10)
    )


def _between(hand: HandModel, joint: int) -> Float[Tensor, "3 3"]:
    """Anatomical axes of a joint's child bone in those of its parent, in the anatomical neutral."""
    own = hand.frames[joint - 1] @ angles_to_rotation(hand.rest_angles[joint - 1]).mT
    parent = PARENTS[joint]
    return own if parent == 0 else hand.frames[parent - 1].mT @ own


def _bend_and_splay(bone: Float[Tensor, "hand 3"]) -> Float[Tensor, "hand axis=3"]:
    """Angles that rotate a straight bone, which points along −x, into a direction; zero if it is missing.

    A bone that points backwards is bent by more than 90°, not splayed by as much.
    """
    x, y, z = bone.unbind(-1)
    forward = x <= 0
    sign = torch.where(forward, 1.0, -1.0)
    bend = torch.atan2(-y, sign * torch.hypot(x, z))
    splay = torch.atan2(sign * z, -sign * x)
    # A bone along the axis of splay has none.
    splay = torch.where(torch.hypot(x, z) > 1e-3 * bone.norm(dim=-1), splay, 0.0)
    return torch.stack([bend, splay, torch.zeros_like(bend)], dim=-1).nan_to_num(0.0)


def _palm_rotation(
    rest: Float[Tensor, "landmark=21 3"], points: Float[Tensor, "hand landmark=21 3"]
) -> Float[Tensor, "hand 3 3"]:
    """Rotation of the palm from the hand's frame; of all landmarks where fewer than three of it are there."""
    finite = points.isfinite().all(dim=-1)
    palm = torch.zeros_like(finite)
    palm[:, list(PALM)] = True
    palm &= finite
    used = torch.where((palm.sum(dim=1) >= _LEAST_PALM)[:, None], palm, finite)
    return rotation_between(rest.expand_as(points), points, used)


def rotation_between(
    source: Float[Tensor, "hand landmark 3"],
    target: Float[Tensor, "hand landmark 3"],
    used: Bool[Tensor, "hand landmark"],
) -> Float[Tensor, "hand 3 3"]:
    """Proper rotation that brings points nearest to others, after both were centred (Kabsch).

    Args:
        source: Points to rotate.
        target: Points to meet.
        used: Mask of the pairs that count.
    """
    weight = used.to(source)[..., None]
    count = weight.sum(dim=1, keepdim=True).clamp(min=1)
    target = target.nan_to_num(0.0)
    centred = [
        (points - (points * weight).sum(dim=1, keepdim=True) / count) * weight
        for points in (source, target)
    ]
    left, _, right = torch.linalg.svd(centred[1].mT @ centred[0])
    sign = torch.ones_like(left[:, 0])
    sign[:, 2] = torch.linalg.det(left) * torch.linalg.det(right)
    return (left * sign[:, None]) @ right
