"""Surfaces of hands in random poses, with an open or a closed wrist."""

import torch
from torch import Tensor

from hand_recon.hand.model import HandModel


def random_vertices(hand: HandModel, count: int, spread: float = 0.6) -> Tensor:
    """Vertices of hands of random shape and pose, most of which penetrate themselves.

    Args:
        hand: The hand model.
        count: Number of hands.
        spread: Standard deviation of the joint angles about every axis, radians.
    """
    return hand(spread * torch.randn(count, 15, 3), torch.randn(count, 10)).vertices


def capped(hand: HandModel, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """Vertices with the centre of the wrist ring appended, and the faces of the closed surface."""
    points = torch.cat([vertices, vertices[:, hand.wrist_ring].mean(dim=1, keepdim=True)], dim=1)
    ring, centre = hand.wrist_ring, torch.full_like(hand.wrist_ring, vertices.shape[1])
    return points, torch.cat([hand.faces, torch.stack([ring, ring.roll(-1), centre], dim=1)])
