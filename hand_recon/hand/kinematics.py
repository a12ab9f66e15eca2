"""Forward kinematics of the hand: five chains of three joints on the wrist (Sec. 3.1)."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.skeleton import LEVEL_ORDER

CHAINS: Final = 5
"""Chains of joints that begin at the wrist, one per finger."""
LEVELS: Final = 3
"""Joints of a chain."""

_FROM_LEVELS: Final = tuple(LEVEL_ORDER.index(joint) for joint in range(len(LEVEL_ORDER)))
"""Place of each of MANO's joints in the order by levels."""
_ROTATIONS: Final = tuple(joint - 1 for joint in LEVEL_ORDER[1:])


def forward_kinematics(
    rotations: Float[Tensor, "hand joint=15 3 3"], joints: Float[Tensor, "hand joint=16 3"]
) -> tuple[Float[Tensor, "hand joint=16 3 3"], Float[Tensor, "hand joint=16 3"]]:
    """Orientation and centre of every joint; all fingers take one step per level of the skeleton.

    Args:
        rotations: Rotation of each joint from the rest pose, relative to its parent.
        joints: Rotation centres at rest, metres.
    """
    count = len(joints)
    steps = rotations[:, _ROTATIONS].view(count, LEVELS, CHAINS, 3, 3)
    rest = joints[:, LEVEL_ORDER]
    first, second, third = steps.unbind(dim=1)
    second = first @ second
    orientations = torch.stack([first, second, second @ third], dim=1)
    # The wrist does not turn in the hand's frame, so the chains begin at their centres at rest.
    chains = rest[:, 1:].view(count, LEVELS, CHAINS, 3)
    bones = (orientations[:, :-1] @ chains.diff(dim=1)[..., None])[..., 0]
    centres = chains[:, :1] + torch.cat(
        [torch.zeros_like(bones[:, :1]), bones.cumsum(dim=1)], dim=1
    )
    wrist = torch.eye(3, dtype=joints.dtype, device=joints.device).expand(count, 1, 3, 3)
    return (
        torch.cat([wrist, orientations.flatten(1, 2)], dim=1)[:, _FROM_LEVELS],
        torch.cat([rest[:, :1], centres.flatten(1, 2)], dim=1)[:, _FROM_LEVELS],
    )
