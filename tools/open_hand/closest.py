"""Nearest points on a triangle mesh, exact, by brute force over all triangles."""

import numpy as np
from jaxtyping import Float, Int

CHUNK = 64
"""Points per step, which bounds the memory."""


def closest_barycentric(
    points: Float[np.ndarray, "point 3"],
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
) -> Float[np.ndarray, "point vertex"]:
    """Barycentric weights over the mesh's vertices of the surface point nearest to each point."""
    weights = np.zeros((len(points), len(vertices)))
    for start in range(0, len(points), CHUNK):
        part = points[start : start + CHUNK]
        shares = _barycentric_per_face(part, vertices[faces])
        nearest = np.einsum("pfc,fcx->pfx", shares, vertices[faces])
        face = np.linalg.norm(nearest - part[:, None], axis=-1).argmin(axis=1)
        rows = np.arange(len(part))
        np.add.at(weights[start : start + CHUNK], (rows[:, None], faces[face]), shares[rows, face])
    return weights


def distances(
    points: Float[np.ndarray, "point 3"],
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
) -> Float[np.ndarray, " point"]:
    """Distance of each point to the surface, in the unit of the vertices."""
    nearest = closest_barycentric(points, vertices, faces) @ vertices
    return np.asarray(np.linalg.norm(nearest - points, axis=1))


def _barycentric_per_face(
    points: Float[np.ndarray, "point 3"], triangles: Float[np.ndarray, "face 3 3"]
) -> Float[np.ndarray, "point face 3"]:
    """Barycentric coordinates of the nearest point of every triangle to every point."""
    inside = _projection(points, triangles)
    best = np.where((inside >= 0).all(axis=-1, keepdims=True), inside, 0.0)
    gap = np.where((inside >= 0).all(axis=-1), _gap(points, triangles, best), np.inf)
    for corner in range(3):
        following = (corner + 1) % 3
        along = triangles[:, following] - triangles[:, corner]
        offset = points[:, None] - triangles[:, corner]
        t = ((offset * along).sum(-1) / (along * along).sum(-1)).clip(0, 1)
        edge = np.zeros((*t.shape, 3))
        edge[..., corner], edge[..., following] = 1 - t, t
        edge_gap = _gap(points, triangles, edge)
        best = np.where((edge_gap < gap)[..., None], edge, best)
        gap = np.minimum(gap, edge_gap)
    return best


def _projection(
    points: Float[np.ndarray, "point 3"], triangles: Float[np.ndarray, "face 3 3"]
) -> Float[np.ndarray, "point face 3"]:
    """Barycentric coordinates of every point's projection on every triangle's plane; negative outside."""
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    offset = points[:, None] - triangles[:, 0]
    wu, wv = (offset * u).sum(-1), (offset * v).sum(-1)
    second = (vv * wu - uv * wv) / (uu * vv - uv * uv)
    third = (uu * wv - uv * wu) / (uu * vv - uv * uv)
    return np.stack([1 - second - third, second, third], axis=-1)


def _gap(
    points: Float[np.ndarray, "point 3"],
    triangles: Float[np.ndarray, "face 3 3"],
    shares: Float[np.ndarray, "point face 3"],
) -> Float[np.ndarray, "point face"]:
    nearest = np.einsum("pfc,fcx->pfx", shares, triangles)
    return np.asarray(np.square(nearest - points[:, None]).sum(-1))
