"""Points of a hand as sums over the joints of rotation times a constant vector (Sec. 3.1).

Skinning and landmark regressors are linear, so any weighted sum of vertices and rotation centres is

    point = Σⱼ Cⱼ (bⱼ + Dⱼ β),

where the columns of Cⱼ are the world directions of joint j's anatomical axes and β is the shape. A rotation
of joint k rotates the summands of the joints in its subtree, and nothing else, about its own centre. The
derivative by an angle is therefore axis × (sum over the subtree), without any rotation centre.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.anatomical_frame import angles_to_rotation
from hand_recon.hand.kinematics import CHAINS
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LEVEL_ORDER, PARENTS, ROOT_JOINT


def subtrees() -> Bool[Tensor, "joint=16 joint=16"]:
    """Mask of the joints in the subtree of each joint, itself included, in MANO's order."""
    mask = torch.eye(len(PARENTS), dtype=torch.bool)
    for joint in reversed(range(1, len(PARENTS))):
        mask[PARENTS[joint]] |= mask[joint]
    return mask


@dataclass(frozen=True)
class ChainPoints:
    """Vectors bⱼ and Dⱼ of a set of points, in the anatomical axes of each joint; joints by level."""

    mean: Float[Tensor, "point joint=16 3"]
    """bⱼ of the mean shape, metres."""
    shape_directions: Float[Tensor, "point joint=16 3 direction=10"]
    """Dⱼ, metres per standard deviation."""


def chain_points(hand: HandModel, weights: Float[Tensor, "point source"]) -> ChainPoints:
    """Express weighted sums of vertices and rotation centres as sums over joints.

    Pose blend shapes, where the hand has them, are left out.

    Args:
        hand: Hand model.
        weights: Weight of every vertex, then of every rotation centre.
    """
    count = len(hand.template)
    needed = weights[:, :count].any(dim=0)
    of_vertices, of_joints = weights[:, :count][:, needed].double(), weights[:, count:].double()
    vertices, joints = _rest(hand, needed)
    skinned = torch.einsum(
        "pv,vj,vxs->pjxs", of_vertices, hand.skinning_weights[needed].double(), vertices
    )
    share = of_vertices @ hand.skinning_weights[needed].double()
    offsets = skinned - share[..., None, None] * joints
    return _chain(hand, share + of_joints, offsets, joints)


def chain_vertices(hand: HandModel) -> ChainPoints:
    """Express every vertex as a sum over joints, without pose blend shapes.

    Args:
        hand: Hand model.
    """
    vertices, joints = _rest(hand, torch.ones_like(hand.template[:, 0], dtype=torch.bool))
    share = hand.skinning_weights.double()
    offsets = share[..., None, None] * (vertices[:, None] - joints)
    return _chain(hand, share, offsets, joints)


def _rest(
    hand: HandModel, needed: Bool[Tensor, " vertex"]
) -> tuple[
    Float[Tensor, "vertex_needed 3 coefficient=11"], Float[Tensor, "joint=16 3 coefficient=11"]
]:
    """Coefficients of the mean, then of the shape directions: some vertices, and all rotation centres."""
    vertices = torch.cat([hand.template[..., None], hand.shape_directions], dim=-1)
    joints = torch.cat([hand.joints_template[..., None], hand.joint_shape_directions], dim=-1)
    return vertices[needed].double(), joints.double()


def _chain(
    hand: HandModel, share: Float[Tensor, "point joint=16"], offsets: Tensor, joints: Tensor
) -> ChainPoints:
    """Add the bones on the way to each point to its offsets from the joints that move it.

    Args:
        hand: Hand model.
        share: Share of each joint's motion in each point.
        offsets: Point × joint × 3 × coefficient: offset from each joint's centre, times that share.
        joints: Rotation centres.
    """
    # A centre is the sum of the bones on the way to it, each rotated by the joint where it begins.
    below = share @ subtrees().to(share).mT
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            offsets[:, parent] += below[:, joint, None, None] * (joints[joint] - joints[parent])
    offsets[:, 0] += below[:, 0, None, None] * (joints[0] - joints[ROOT_JOINT])
    offsets[:, 1:] = torch.einsum("jyx,pjys->pjxs", hand.frames.double(), offsets[:, 1:])
    offsets = offsets[:, list(LEVEL_ORDER)].to(hand.template.dtype)
    return ChainPoints(offsets[..., 0].contiguous(), offsets[..., 1:].contiguous())


class Skeleton:
    """Orientations of the joints' anatomical axes and the axes of rotation of all joint angles.

    Hands are the last axis, so that products are sums of a few long rows.

    Args:
        hand: Hand model.
    """

    def __init__(self, hand: HandModel) -> None:
        frames, rest = hand.frames, angles_to_rotation(hand.rest_angles)
        between = []
        for joint, parent in enumerate(PARENTS):
            if parent < 0:
                continue
            own = frames[joint - 1] @ rest[joint - 1].mT
            between.append(own if parent == 0 else frames[parent - 1].mT @ own)
        self._order = [joint - 1 for joint in LEVEL_ORDER[1:]]
        # Axes of the child at rest in those of its parent.
        self._between = torch.stack(between)[self._order].permute(1, 2, 0)[..., None].contiguous()

    def __call__(
        self,
        joint_angles: Float[Tensor, "hand joint=15 axis=3"],
        root_rotation: Float[Tensor, "hand 3 3"],
    ) -> tuple[Float[Tensor, "3 3 joint=16 hand"], Float[Tensor, "3 axis=3 joint=16 hand"]]:
        """Orientations and axes in the camera's frame, joints by level.

        Args:
            joint_angles: Bend, splay and twist from the anatomical neutral, radians.
            root_rotation: Rotation from the hand's frame to the camera's.

        Returns:
            World directions of the anatomical axes, one per column; and the axis of rotation of each angle
            (bend, splay, twist), one per column. The axes of the root are the camera's.
        """
        bend, splay, twist = joint_angles.permute(2, 1, 0)[:, self._order].unbind(0)
        cos_z, sin_z = bend.cos(), bend.sin()
        cos_y, sin_y = splay.cos(), splay.sin()
        cos_x, sin_x = twist.cos(), twist.sin()
        one, zero = torch.ones_like(bend), torch.zeros_like(bend)
        local = torch.stack([
            cos_y * cos_z + sin_y * sin_x * sin_z, sin_y * sin_x * cos_z - cos_y * sin_z, sin_y * cos_x,
            cos_x * sin_z, cos_x * cos_z, -sin_x,
            cos_y * sin_x * sin_z - sin_y * cos_z, sin_y * sin_z + cos_y * sin_x * cos_z, cos_y * cos_x,
        ]).unflatten(0, (3, 3))  # fmt: skip
        # Columns bend, splay, twist in the child's axes.
        axes = torch.stack([
            zero, sin_z * cos_x, cos_z,
            zero, cos_z * cos_x, -sin_z,
            one, -sin_x, zero,
        ]).unflatten(0, (3, 3))  # fmt: skip
        steps = product(self._between, local)
        parent = root_rotation.permute(1, 2, 0)[:, :, None]
        levels = [parent]
        for level in steps.split(CHAINS, dim=2):
            parent = product(parent, level)
            levels.append(parent)
        orientations = torch.cat(levels, dim=2)
        eye = torch.eye(3, dtype=parent.dtype, device=parent.device)[..., None, None]
        world = product(orientations[:, :, 1:], axes)
        return orientations, torch.cat([eye.expand(3, 3, 1, len(root_rotation)), world], dim=2)


def product(
    first: Float[Tensor, "3 3 #item #hand"], second: Float[Tensor, "3 3 #item #hand"]
) -> Float[Tensor, "3 3 item hand"]:
    """Products of many 3 × 3 matrices with the matrices' own axes first."""
    return (first[:, :, None] * second[None]).sum(dim=1)
