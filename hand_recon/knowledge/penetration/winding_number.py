"""Generalized winding number of closed surfaces: the inside test of non-penetration (Sec. 3.2, Eq. 4).

It is the sum of the triangles' solid angles at a point (Jacobson et al., ACM TOG 2013; Van Oosterom &
Strackee, IEEE TBME 1983) over 4π: 1 inside, 0 outside, 2 where two closed surfaces overlap.
"""

import math
from typing import Final

import torch
from jaxtyping import Float, Int
from torch import Tensor

SOLID_ANGLES_AT_ONCE: Final = 1 << 16
"""Most solid angles in memory at once: about 6 MB in single precision."""


@torch.no_grad()
def winding_number(
    points: Float[Tensor, "query 3"],
    hand: Int[Tensor, " query"],
    vertices: Float[Tensor, "hand vertex 3"],
    faces: Int[Tensor, "face 3"],
    *,
    at_once: int = SOLID_ANGLES_AT_ONCE,
) -> Float[Tensor, " query"]:
    """Winding number of closed surfaces at points, without gradient.

    Queries are a flat list, so that only the points to test cost time.

    If a point *is* a vertex of its surface, the triangles that meet there have a solid angle of exactly zero.
    The winding number is then the share of directions that lead inwards at that vertex (½ where the surface
    is flat, always between 0 and 1) plus the number of other layers around it. A vertex is therefore inside
    another part of its own surface if its winding number is above 1, and a point of another surface is inside
    if it is above ½.

    Args:
        points: Points to test, metres.
        hand: Index of the surface for each point.
        vertices: Vertices of every surface, metres.
        faces: Triangles of all surfaces, counter-clockwise from outside, without a boundary.
        at_once: Most solid angles in memory at once; does not change the value.

    Raises:
        ValueError: `at_once` is not positive.
    """
    if at_once < 1:
        raise ValueError(f"at_once must be at least one solid angle, found {at_once}.")
    several = max(1, at_once // max(1, len(faces)))
    surfaces = vertices.transpose(1, 2).contiguous()
    # In the order hand, axis, vertex, the lookup of a hand copies whole rows.
    return torch.cat(
        [
            _windings(surfaces.index_select(0, index) - position[..., None], faces)
            for position, index in zip(points.split(several), hand.split(several), strict=True)
        ]
    )


def _windings(
    rays: Float[Tensor, "query 3 vertex"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, " query"]:
    """Sum of the triangles' solid angles over 4π, from the rays to the vertices."""
    # With the queries last, the lookup of a corner copies whole rows.
    rays = rays.permute(1, 2, 0).contiguous()
    lengths = _dot(rays, rays).sqrt()
    a, b, c = (rays.index_select(1, corner) for corner in faces.T)
    long_a, long_b, long_c = (lengths.index_select(0, corner) for corner in faces.T)
    return turns(a, b, c, (long_a, long_b, long_c))


def turns(
    a: Float[Tensor, "3 face query"],
    b: Float[Tensor, "3 face query"],
    c: Float[Tensor, "3 face query"],
    lengths: tuple[Tensor, Tensor, Tensor] | None = None,
) -> Float[Tensor, " query"]:
    """Sum of triangles' solid angles over 4π, from the rays to their corners.

    A triangle whose corners are one point has a solid angle of zero.

    Args:
        a: Rays to the first corners.
        b: Rays to the second corners.
        c: Rays to the third corners.
        lengths: Their lengths, where they are known.
    """
    long_a, long_b, long_c = lengths or tuple(_dot(ray, ray).sqrt() for ray in (a, b, c))
    volume = (b[1] * c[2] - b[2] * c[1]) * a[0]
    volume += (b[2] * c[0] - b[0] * c[2]) * a[1]
    volume += (b[0] * c[1] - b[1] * c[0]) * a[2]
    flatness = long_a * long_b * long_c
    flatness += _dot(a, b) * long_c
    flatness += _dot(a, c) * long_b
    flatness += _dot(b, c) * long_a
    # Ω = 2 atan2(volume, flatness), and the whole sphere is 4π.
    return torch.atan2(volume, flatness).sum(dim=0) / (2 * math.pi)


def _dot(
    first: Float[Tensor, "3 point query"], second: Float[Tensor, "3 point query"]
) -> Float[Tensor, "point query"]:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]
