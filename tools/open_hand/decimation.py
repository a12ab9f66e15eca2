"""Edge-collapse decimation by quadric error (Garland & Heckbert 1997) to an exact number of vertices."""

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from open_hand.closest import closest_barycentric

LENGTH_PENALTY = 4e-7
"""Weight of an edge's squared length beside the quadric error, m²; it evens out the mesh."""

BOUNDARY_WEIGHT = 0.1
"""Weight of the quadrics that keep the open boundary in place."""

LEAST_COSINE = 0.3
"""Cosine of the largest angle by which a collapse may rotate a triangle's normal."""


@dataclass(frozen=True)
class Decimation:
    """A coarser mesh and the positions of its vertices on the finer one."""

    vertices: Float[np.ndarray, "coarse 3"]
    """Vertices of the coarser mesh, metres."""
    faces: Int[np.ndarray, "face 3"]
    """Triangles of the coarser mesh, with the finer mesh's orientation."""
    barycentric: Float[np.ndarray, "coarse vertex"]
    """Barycentric weights over the finer mesh's vertices of the surface point nearest to each vertex."""


class _Collapser:
    """The mesh during decimation, with a quadric per vertex."""

    def __init__(
        self,
        vertices: Float[np.ndarray, "vertex 3"],
        faces: Int[np.ndarray, "face 3"],
        pinned: set[int],
    ) -> None:
        self.points = vertices.copy()
        self.pinned = pinned
        self.triangles = {index: tuple(map(int, face)) for index, face in enumerate(faces)}
        self.incident: dict[int, set[int]] = {index: set() for index in range(len(vertices))}
        for index, face in self.triangles.items():
            for corner in face:
                self.incident[corner].add(index)
        self.quadrics = np.zeros((len(vertices), 4, 4))
        for face in self.triangles.values():
            self._add_face_quadric(face)
        self.boundary = self._boundary()

    def _add_face_quadric(self, face: tuple[int, ...]) -> None:
        a, b, c = self.points[list(face)]
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal) / 2
        plane = np.append(normal, -normal @ a) / (2 * area)
        for corner in face:
            self.quadrics[corner] += area * np.outer(plane, plane)

    def _boundary(self) -> set[int]:
        loose: set[int] = set()
        for face in self.triangles.values():
            for start, end in zip(face, face[1:] + face[:1], strict=True):
                if len(self.incident[start] & self.incident[end]) == 1:
                    loose |= {start, end}
                    self._add_boundary_quadric(face, start, end)
        return loose

    def _add_boundary_quadric(self, face: tuple[int, ...], start: int, end: int) -> None:
        a, b, c = self.points[list(face)]
        along = self.points[end] - self.points[start]
        normal = np.cross(along, np.cross(b - a, c - a))
        normal /= np.linalg.norm(normal)
        plane = np.append(normal, -normal @ self.points[start])
        for corner in (start, end):
            self.quadrics[corner] += BOUNDARY_WEIGHT * (along @ along) * np.outer(plane, plane)

    def neighbours(self, vertex: int) -> set[int]:
        """Vertices that share a triangle with this one."""
        return {corner for face in self.incident[vertex] for corner in self.triangles[face]} - {
            vertex
        }

    def candidate(self, a: int, b: int) -> tuple[float, int, int, tuple[float, ...]] | None:
        """The cheapest collapse of an edge: cost, kept and removed vertex, position; None if forbidden."""
        if self._fixed(b) and not self._fixed(a):
            a, b = b, a
        if self._fixed(b) and (b in self.pinned or a not in self.boundary):
            return None
        quadric = self.quadrics[a] + self.quadrics[b]
        ends = [self.points[a]]
        if not self._fixed(a):
            ends += [self.points[b], (self.points[a] + self.points[b]) / 2, *self._best(quadric)]
        costs = [np.append(p, 1) @ quadric @ np.append(p, 1) for p in ends]
        best = int(np.argmin(costs))
        length = self.points[a] - self.points[b]
        cost = float(costs[best] + LENGTH_PENALTY * (length @ length))
        if {a, b} <= self.boundary:
            # The boundary at the wrist has no shape to preserve, so it is thinned first.
            cost *= 1e-3
        return cost, a, b, tuple(map(float, ends[best]))

    def _fixed(self, vertex: int) -> bool:
        return vertex in self.pinned or vertex in self.boundary

    @staticmethod
    def _best(quadric: Float[np.ndarray, "4 4"]) -> list[Float[np.ndarray, " 3"]]:
        if np.linalg.cond(quadric[:3, :3]) > 1e4:
            return []
        return [np.linalg.solve(quadric[:3, :3], -quadric[:3, 3])]

    def joined(self, a: int, b: int) -> bool:
        """True if there is still an edge between two vertices."""
        return a in self.incident and b in self.incident and b in self.neighbours(a)

    def allowed(
        self, stays: int, goes: int, position: tuple[float, ...], boundary_count: int
    ) -> bool:
        """True if after a collapse the mesh is a manifold, keeps its boundary, and no triangle folds over."""
        shared = self.incident[stays] & self.incident[goes]
        if len(self.neighbours(stays) & self.neighbours(goes)) != len(shared):
            return False
        boundary_done = len(self.boundary) <= boundary_count
        if {stays, goes} <= self.boundary and (len(shared) != 1 or boundary_done):
            return False
        touched = (self.incident[stays] | self.incident[goes]) - shared
        return all(self._stays_unfolded(face, (stays, goes), position) for face in touched)

    def _stays_unfolded(
        self, face: int, moving: tuple[int, int], position: tuple[float, ...]
    ) -> bool:
        corners = self.triangles[face]
        before = self.points[list(corners)]
        after = np.array([position if c in moving else self.points[c] for c in corners])
        normals = [np.cross(p[1] - p[0], p[2] - p[0]) for p in (before, after)]
        sizes = [np.linalg.norm(normal) for normal in normals]
        longest = max(float(np.sum((after[i] - after[i - 1]) ** 2)) for i in range(3))
        if sizes[1] < 0.15 * longest:
            return False
        return bool(normals[0] @ normals[1] > LEAST_COSINE * sizes[0] * sizes[1])

    def collapse(self, stays: int, goes: int, position: tuple[float, ...]) -> None:
        """Merge two vertices into one at a position."""
        for face in self.incident[stays] & self.incident[goes]:
            for corner in self.triangles.pop(face):
                self.incident[corner].discard(face)
        for face in self.incident.pop(goes):
            self.triangles[face] = tuple(stays if c == goes else c for c in self.triangles[face])
            self.incident[stays].add(face)
        self.points[stays] = position
        self.quadrics[stays] += self.quadrics[goes]
        self.boundary.discard(goes)


def decimate(
    vertices: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    counts: tuple[int, int],
    pinned: list[int],
) -> Decimation:
    """Collapse edges, cheapest first, until a given number of vertices is left.

    Args:
        vertices: Vertices of the finer mesh, which has one open boundary; metres.
        faces: Triangles of the finer mesh.
        counts: Number of vertices of the result, and of those on its open boundary.
        pinned: Vertices that are not moved; they become the first ones of the result.

    Raises:
        ValueError: No allowed collapse is left before the count is reached.
    """
    count, boundary_count = counts
    work = _Collapser(vertices, faces, set(pinned))
    queue = [
        edge
        for a in work.incident
        for b in work.neighbours(a)
        if a < b and (edge := work.candidate(a, b))
    ]
    heapq.heapify(queue)
    while len(work.incident) > count:
        if not queue:
            raise ValueError(
                f"No allowed collapse is left at {len(work.incident)} vertices, expected {count}. Ask for "
                "more vertices, or pin fewer."
            )
        cost, stays, goes, _ = heapq.heappop(queue)
        current = work.candidate(stays, goes) if work.joined(stays, goes) else None
        if current is None:
            continue
        if current[0] > cost + 1e-15:
            # The neighbourhood has changed since the cost was computed.
            heapq.heappush(queue, current)
            continue
        _, stays, goes, position = current
        if work.allowed(stays, goes, position, boundary_count):
            work.collapse(stays, goes, position)
            edges = [work.candidate(stays, other) for other in sorted(work.neighbours(stays))]
            for edge in filter(None, edges):
                heapq.heappush(queue, edge)
    return _finish(work, vertices, faces, pinned)


def _finish(
    work: _Collapser,
    mesh_vertices: Float[np.ndarray, "vertex 3"],
    mesh_faces: Int[np.ndarray, "face 3"],
    pinned: list[int],
) -> Decimation:
    order = pinned + sorted(set(work.incident) - set(pinned))
    position = {vertex: index for index, vertex in enumerate(order)}
    faces = np.array([[position[c] for c in work.triangles[f]] for f in sorted(work.triangles)])
    vertices = work.points[order]
    barycentric = closest_barycentric(vertices, mesh_vertices, mesh_faces)
    return Decimation(vertices, faces, barycentric)
