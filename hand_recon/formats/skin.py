"""Skins with at most four joints per vertex and without blend shapes, which all that play glTF support."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, UInt8

from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import Trajectory

INFLUENCES: Final = 4
"""Joints that may move a vertex: one set of a glTF mesh."""

_FRAMES_AT_ONCE: Final = 256


def strongest(
    weights: Float[np.ndarray, "vertex joint=16"],
) -> tuple[UInt8[np.ndarray, "vertex influence=4"], Float[np.ndarray, "vertex influence=4"]]:
    """Choose the joints that move each vertex most, and scale their weights to a sum of one.

    Args:
        weights: Weights of all joints.

    Returns:
        Indices of joints, 0 where a vertex has fewer, and their weights in single precision.
    """
    chosen = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    kept = np.take_along_axis(weights, chosen, axis=1)
    kept /= kept.sum(axis=1, keepdims=True)
    return np.where(kept > 0, chosen, 0).astype(np.uint8), kept.astype(np.float32)


def left_out_of(hand: HandModel) -> str:
    """Name the parts of a hand model that such a skin leaves out; empty if there are none."""
    crowded = int((hand.skinning_weights > 0).sum(dim=1).max()) > INFLUENCES
    parts = ["pose blend shapes"] if hand.pose_directions is not None else []
    return " and ".join([*parts, "skinning weights beyond four per vertex"] if crowded else parts)


def largest_difference(trajectories: Sequence[Trajectory], hand: HandModel) -> float:
    """Largest distance between a vertex of the hand model and the same of such a skin, metres.

    Args:
        trajectories: Poses to compare, all frames of them.
        hand: Model of the right hand.
    """
    joints, kept = strongest(hand.skinning_weights.detach().cpu().double().numpy())
    weights = np.zeros(hand.skinning_weights.shape)
    np.add.at(weights, (np.arange(len(weights))[:, None], joints), kept)
    plain = hand.with_arrays(
        pose_directions=None, skinning_weights=torch.as_tensor(weights).to(hand.skinning_weights)
    )
    largest = 0.0
    with torch.no_grad():
        for trajectory in trajectories:
            shape = torch.as_tensor(trajectory.shape).to(hand.template)
            for angles in torch.as_tensor(trajectory.joint_angles).split(_FRAMES_AT_ONCE):
                poses = angles.to(hand.template), shape.expand(len(angles), -1)
                distances = (hand(*poses).vertices - plain(*poses).vertices).norm(dim=-1)
                largest = max(largest, float(distances.max()))
    return largest
