"""Depth of vertices inside other parts by definition: every vertex, part and triangle (Eq. 4, d(v))."""

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from hand_recon.knowledge.penetration.closed_parts import ClosedParts


def winding_numbers(
    points: Float[np.ndarray, "point 3"], triangles: Float[np.ndarray, "triangle corner=3 3"]
) -> Float[np.ndarray, " point"]:
    """Sum of solid angles over 4π, every point with every triangle (Van Oosterom & Strackee, 1983).

    Args:
        points: Points to test, metres.
        triangles: Corners of a closed surface, counter-clockwise from outside, metres.
    """
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    long_a, long_b, long_c = (np.linalg.norm(ray, axis=-1) for ray in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=-1)
    flatness = long_a * long_b * long_c
    flatness += (a * b).sum(axis=-1) * long_c
    flatness += (b * c).sum(axis=-1) * long_a + (c * a).sum(axis=-1) * long_b
    total: np.ndarray = 2 * np.arctan2(volume, flatness).sum(axis=1) / (4 * np.pi)
    return total


def containing(
    vertices: Float[np.ndarray, "vertex 3"], parts: ClosedParts
) -> Bool[np.ndarray, "vertex part"]:
    """Mask of the parts that contain each vertex, among those that it can penetrate.

    Args:
        vertices: Of one hand, metres.
        parts: Closed parts of the hand.
    """
    points = np.concatenate([vertices, parts.centres @ vertices])
    inside = np.zeros_like(parts.opponents)
    for part, faces in enumerate(parts.faces):
        asked = np.flatnonzero(parts.opponents[:, part])
        inside[asked, part] = winding_numbers(vertices[asked], points[faces]) > 0.5
    return inside


def depths(
    vertices: Float[np.ndarray, "vertex 3"],
    parts: ClosedParts,
    geodesics: Float[np.ndarray, "vertex vertex"],
    near: float,
) -> Float[np.ndarray, " vertex"]:
    """Depth d(v) of the vertices inside another part, metres; zero for the others.

    Args:
        vertices: Of one hand, metres.
        parts: Closed parts of the hand.
        geodesics: Geodesic distances of the vertices at rest, metres.
        near: Geodesic distance up to which the nearest skin is a fold, metres.
    """
    result = np.zeros(len(vertices))
    inside = containing(vertices, parts)
    for vertex, part in np.argwhere(inside):
        around = parts.adjacent[part] & parts.opponents[vertex]
        faces = parts.skin[around[parts.part_of_face]]
        here = np.repeat(vertices[vertex][None], len(faces), axis=0)
        nearest = trimesh.triangles.closest_point(vertices[faces], here)  # type: ignore[no-untyped-call]
        distances = np.linalg.norm(nearest - here, axis=1)
        first = distances.argmin()
        corners = faces[first]
        share = trimesh.triangles.points_to_barycentric(  # type: ignore[no-untyped-call]
            vertices[corners][None], nearest[first][None]
        )
        if share[0] @ geodesics[vertex][corners] > near:
            result[vertex] = max(result[vertex], distances.min())
    return result
