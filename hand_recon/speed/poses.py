"""Poses that the benchmark measures with: gestures, and random angles as bad as a new network's."""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand

KINDS: Final = ("natural", "wild")
"""Gestures; and angles that are normally distributed about all axes, SD 34°, where fingers cross."""


def joint_angles(kind: str, count: int) -> Float[Tensor, "hand joint=15 axis=3"]:
    """Joint angles of one of `KINDS`, radians, the same on every call.

    Args:
        kind: One of `KINDS`.
        count: Number of hands.
    """
    random = np.random.default_rng(0)
    if kind == "natural":
        return torch.from_numpy(np.stack([sample_pose(random) for _ in range(count)])).float()
    return torch.from_numpy(random.normal(scale=0.6, size=(count, 15, 3))).float()


def shapes(count: int) -> Float[Tensor, "hand direction=10"]:
    """Shapes of random people, standard deviations, the same on every call.

    Args:
        count: Number of hands.
    """
    return torch.randn(count, 10, generator=torch.Generator().manual_seed(0))


def posed_surface(hand: HandModel, kind: str, count: int) -> Float[Tensor, "hand vertex 3"]:
    """Vertices of hands in poses of one of `KINDS` and of random shapes, metres.

    Args:
        hand: The hand model.
        kind: One of `KINDS`.
        count: Number of hands.
    """
    with torch.no_grad():
        angles, shape = joint_angles(kind, count), shapes(count)
        vertices: Tensor = hand(angles.to(hand.template), shape.to(hand.template)).vertices
    return vertices.contiguous()


def blended_hand() -> HandModel:
    """Open hand with as many pose blend shapes as MANO has, of random displacements of 0.1 mm."""
    hand = open_hand()
    generator = torch.Generator().manual_seed(0)
    directions = 1e-4 * torch.randn(*hand.template.shape, 135, generator=generator)
    return hand.with_arrays(pose_directions=directions)
