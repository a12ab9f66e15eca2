"""How often a closed surface winds around a point: the inside test of non-penetration (Sec. 3.2, Eq. 4).

The generalized winding number (Jacobson et al., ACM TOG 2013) adds the solid angles under which a point sees
the triangles (Van Oosterom & Strackee, IEEE TBME 1983): 1 inside, 0 outside, 2 where two parts overlap.
"""

import math
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

SOLID_ANGLES_AT_ONCE: Final = 1 << 16
"""Solid angles that are held at once: about 6 MB in single precision."""


@torch.no_grad()
def winding_number(
    points: Float[Tensor, "query 3"],
    hand: Int[Tensor, " query"],
    vertices: Float[Tensor, "hand vertex 3"],
    faces: Int[Tensor, "face 3"],
    *,
    at_once: int = SOLID_ANGLES_AT_ONCE,
) -> Float[Tensor, " query"]:
    """Winding number of closed surfaces about points, without gradient.

    Queries are a flat list, so that only points in question cost anything.

    A point that *is* a vertex of its surface does not see the triangles that meet there: their solid angles
    are exactly zero. What remains is the share of directions that lead inwards at that vertex (½ where the
    surface is flat, always between 0 and 1) plus the number of other layers around it. So a vertex is inside
    another part of its own surface when its winding number is above 1, and a point of another surface is
    inside when it is above ½.

    Args:
        points: Metres.
        hand: Which of the surfaces each point is asked about.
        vertices: Of every surface, metres.
        faces: Triangles of all surfaces, counter-clockwise from outside, without a boundary.
        at_once: Most solid angles to hold at once; bounds the memory, not the value.

    Raises:
        ValueError: `at_once` is not positive.
    """
    if at_once < 1:
        raise ValueError(f"at_once must be at least one solid angle, found {at_once}.")
    several = max(1, at_once // max(1, len(faces)))
    surfaces = vertices.transpose(1, 2).contiguous()
    # The order is hand, axis, vertex, so that looking up a hand copies whole rows.
    return torch.cat(
        [
            _turns(surfaces.index_select(0, asked) - position[..., None], faces)
            for position, asked in zip(points.split(several), hand.split(several), strict=True)
        ]
    )


def _turns(
    rays: Float[Tensor, "query 3 vertex"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, " query"]:
    """Sum of the triangles' solid angles over the sphere's, from the rays to the vertices."""
    # With the queries last, looking up a corner copies whole rows.
    rays = rays.permute(1, 2, 0).contiguous()
    lengths = _dot(rays, rays).sqrt()
    a, b, c = (rays.index_select(1, corner) for corner in faces.T)
    long_a, long_b, long_c = (lengths.index_select(0, corner) for corner in faces.T)
    volume = (b[1] * c[2] - b[2] * c[1]) * a[0]
    volume += (b[2] * c[0] - b[0] * c[2]) * a[1]
    volume += (b[0] * c[1] - b[1] * c[0]) * a[2]
    flatness = long_a * long_b * long_c
    flatness += _dot(a, b) * long_c
    flatness += _dot(a, c) * long_b
    flatness += _dot(b, c) * long_a
    # Ω = 2 atan2(volume, flatness), and the sphere has 4π.
    return torch.atan2(volume, flatness).sum(dim=0) / (2 * math.pi)


def _dot(
    first: Float[Tensor, "3 place query"], second: Float[Tensor, "3 place query"]
) -> Float[Tensor, "place query"]:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
