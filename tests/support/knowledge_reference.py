"""The knowledge losses by definition in NumPy: Eq. 1 by joint and axis, Eq. 4 by part and vertex."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from hand_recon.knowledge.penetration.closed_parts import ClosedParts

Array = NDArray[np.float64]


def range_of_motion_loss(angles: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Range-of-motion loss, Eq. 1: Σ_j max{θ_j − θ_max, θ_min − θ_j, 0}²."""
    flat = angles.reshape(-1, 15, 3)
    totals = []
    for hand in flat:
        total = 0.0
        for joint in range(15):
            for axis in range(3):
                excess = max(
                    hand[joint, axis] - upper[joint, axis],
                    lower[joint, axis] - hand[joint, axis],
                    0.0,
                )
                total += excess**2
        totals.append(total)
    return np.array(totals).reshape(angles.shape[:-2])


def winding_number(points: Array, triangles: Array) -> Array:
    """Sum of solid angles over 4π, every point with every triangle (Van Oosterom & Strackee)."""
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    long_a, long_b, long_c = (np.linalg.norm(ray, axis=-1) for ray in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=-1)
    flatness = long_a * long_b * long_c
    flatness += (a * b).sum(axis=-1) * long_c
    flatness += (b * c).sum(axis=-1) * long_a + (c * a).sum(axis=-1) * long_b
    total: Array = 2 * np.arctan2(volume, flatness).sum(axis=1) / (4 * np.pi)
    return total


def containing(vertices: Array, parts: ClosedParts) -> NDArray[np.bool_]:
    """Mask of the parts that contain each vertex, among those that it can penetrate."""
    points = np.concatenate([vertices, parts.centres @ vertices])
    inside = np.zeros_like(parts.opponents)
    for part, faces in enumerate(parts.faces):
        asked = np.flatnonzero(parts.opponents[:, part])
        inside[asked, part] = winding_number(vertices[asked], points[faces]) > 0.5
    return inside


def depths(vertices: Array, parts: ClosedParts, geodesics: Array, near: float) -> Array:
    """Depth d(v) of the vertices inside another part, metres; zero for the others."""
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
