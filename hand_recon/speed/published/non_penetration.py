"""Non-penetration as it is published: winding numbers by broadcasting, all distances (Eq. 4)."""

import math
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.closed_parts import geodesic_distances

INSIDE: Final = 0.99
"""Winding number above which a vertex is inside another part of its own surface (TUCH)."""


class PublishedNonPenetration:
    """Eq. 4 of one hand after another, over the whole closed surface.

    Args:
        hand: The hand model.
        geodesic: Geodesic distance at rest up to which two vertices are neighbours, metres.
        tolerance: d_tol, metres.
    """

    def __init__(self, hand: HandModel, geodesic: float = 0.02, tolerance: float = 0.006) -> None:
        ring = hand.wrist_ring
        cap = torch.stack([ring, ring.roll(-1), torch.full_like(ring, len(hand.template))], dim=1)
        self.ring, self.triangles, self.tolerance = ring, torch.cat([hand.faces, cap]), tolerance
        distances = geodesic_distances(
            hand.template.double().cpu().numpy(), hand.faces.cpu().numpy()
        )
        self.near = torch.from_numpy(distances <= geodesic).to(ring.device)

    def __call__(self, vertices: Float[Tensor, "hand vertex 3"]) -> Float[Tensor, " hand"]:
        """The loss of each hand, metres."""
        return torch.stack([self._loss(one) for one in vertices])

    def _loss(self, skin: Float[Tensor, "vertex 3"]) -> Float[Tensor, ""]:
        inside = self.inside(skin.detach())
        distances = (skin[:, None] - skin[None]).square().sum(dim=-1)
        nearest = distances.masked_fill(self.near, torch.inf).argmin(dim=1)
        depths = (skin - skin[nearest]).norm(dim=-1)
        return torch.where(inside, depths - self.tolerance, 0.0).clamp(min=0).sum()

    @torch.no_grad()
    def inside(self, skin: Float[Tensor, "vertex 3"]) -> Bool[Tensor, " vertex"]:
        """Mask of the vertices inside another part of the surface."""
        closed = torch.cat([skin, skin[self.ring].mean(dim=0, keepdim=True)])
        return winding_numbers(skin, closed, self.triangles) > INSIDE


@torch.no_grad()
def winding_numbers(
    points: Float[Tensor, "point 3"],
    vertices: Float[Tensor, "vertex 3"],
    triangles: Int[Tensor, "triangle 3"],
) -> Float[Tensor, " point"]:
    """Sum of all triangles' solid angles at every point, over 4π (Van Oosterom & Strackee, 1983).

    Args:
        points: Points to test, metres.
        vertices: Vertices of a closed surface, metres.
        triangles: Its triangles, counter-clockwise from outside.
    """
    rays = vertices[triangles][None] - points[:, None, None]
    a, b, c = rays.unbind(dim=2)
    long_a, long_b, long_c = rays.norm(dim=-1).unbind(dim=2)
    volume = (a * torch.linalg.cross(b, c)).sum(dim=-1)
    flatness = long_a * long_b * long_c + (a * b).sum(dim=-1) * long_c
    flatness = flatness + (a * c).sum(dim=-1) * long_b + (b * c).sum(dim=-1) * long_a
    return torch.atan2(volume, flatness).sum(dim=1) / (2 * math.pi)
