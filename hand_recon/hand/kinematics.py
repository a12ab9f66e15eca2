"""Forward kinematics of the hand: five chains of three joints on the wrist (Sec. 3.1)."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

CHAINS: Final = 5
"""Chains of joints that begin at the wrist, one per finger, each one after another in MANO's order."""
LEVELS: Final = 3
"""Joints of a chain."""


def forward_kinematics(
    rotations: Float[Tensor, "hand joint=15 3 3"], joints: Float[Tensor, "hand joint=16 3"]
) -> tuple[Float[Tensor, "hand joint=16 3 3"], Float[Tensor, "hand joint=16 3"]]:
    """Orientation and centre of every joint; all fingers take one step per level of the skeleton.

    Args:
        rotations: Rotation of each joint from the rest pose, relative to its parent.
        joints: Rotation centres at rest, metres.
    """
    steps = rotations.unflatten(1, (CHAINS, LEVELS))
    first, second, third = steps.unbind(dim=2)
    second = first @ second
    orientations = torch.stack([first, second, second @ third], dim=2)
    # The wrist does not turn in the hand's frame, so a chain begins at its centre at rest.
    chains = joints[:, 1:].unflatten(1, (CHAINS, LEVELS))
    bones = (orientations[:, :, :-1] @ chains.diff(dim=2)[..., None])[..., 0]
    centres = torch.cat([chains[:, :, :1], bones], dim=2).cumsum(dim=2)
    wrist = torch.eye(3, dtype=joints.dtype, device=joints.device).expand(joints.shape[0], 1, 3, 3)
    return (
        torch.cat([wrist, orientations.flatten(1, 2)], dim=1),
        torch.cat([joints[:, :1], centres.flatten(1, 2)], dim=1),
    )
