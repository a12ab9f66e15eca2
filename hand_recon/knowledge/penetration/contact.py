"""Vertices inside another part of the hand and their nearest triangles (Sec. 3.2, M and d(v) of Eq. 4)."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from hand_recon.knowledge.penetration.closed_parts import PALM_PART, ClosedParts
from hand_recon.knowledge.penetration.surface_distance import nearest_on_triangles
from hand_recon.knowledge.penetration.winding_number import winding_number


@dataclass(frozen=True)
class Contacts:
    """Pairs of a vertex inside another part of its hand and a triangle of the skin around it."""

    hand: Int[Tensor, " contact"]
    """Index of the hand."""
    vertex: Int[Tensor, " contact"]
    """Index of the vertex in its hand."""
    part: Int[Tensor, " contact"]
    """Index of the part that contains the vertex."""
    corners: Int[Tensor, "contact corner=3"]
    """Vertex indices of the triangle."""

    @classmethod
    def joined(cls, contacts: list["Contacts"]) -> "Contacts":
        """Concatenate records."""
        columns = [[getattr(some, field.name) for some in contacts] for field in fields(cls)]
        return cls(*map(torch.cat, columns))

    def where(self, chosen: Tensor) -> "Contacts":
        """The pairs that a mask or an index selects."""
        return Contacts(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def depths(self, vertices: Float[Tensor, "hand vertex 3"]) -> Float[Tensor, " contact"]:
        """Distance of each vertex to its triangle, metres, with gradients for both.

        The barycentric coordinates of the nearest point are constants: to first order, a change of them does
        not change the distance.
        """
        triangles = vertices[self.hand[:, None], self.corners]
        nearest = (self.weights(vertices)[..., None] * triangles).sum(dim=-2)
        return (vertices[self.hand, self.vertex] - nearest).norm(dim=-1)

    def weights(
        self, vertices: Float[Tensor, "hand vertex 3"]
    ) -> Float[Tensor, "contact corner=3"]:
        """Barycentric coordinates of the point of each triangle that is nearest to its vertex."""
        # No decorator: PyTorch 2.11 does not compile a decorated method of a plain class.
        with torch.no_grad():
            triangles = vertices[self.hand[:, None], self.corners]
            return nearest_on_triangles(vertices[self.hand, self.vertex], triangles)


def first_of_each(
    group: Int[Tensor, " item"], value: Float[Tensor, " item"]
) -> Int[Tensor, " group"]:
    """Index of the item with the smallest value in every non-empty group.

    Args:
        group: Number of the group of each item.
        value: Value of each item.
    """
    order = value.argsort()
    count = int(group.max()) + 1 if len(group) else 0
    rank = torch.arange(len(order), device=order.device)
    first = rank.new_full((count,), len(order)).scatter_reduce_(0, group[order], rank, "amin")
    return order[first[first < len(order)]]


class PartContacts(nn.Module):
    """Finds the vertices inside one closed part of the hand.

    Winding numbers cost most, so cheaper tests come first: whether a vertex is far enough from the centroids
    of the part's triangles, and for the palm, whose bounds contain much empty space, whether any of it is in
    front of the vertex. Both only rule out vertices that the winding number would rule out.
    """

    vertices: Tensor
    triangles: Tensor
    skin: Tensor
    around: Tensor
    rivals: Tensor
    outline: Tensor

    def __init__(self, parts: ClosedParts, index: int, at_once: int) -> None:
        """Store one part as buffers.

        Args:
            parts: All parts of the hand.
            index: Index of this part.
            at_once: Most solid angles or distances in memory at once.
        """
        super().__init__()
        self.index, self.at_once = index, at_once
        vertices, own = np.unique(parts.faces[index], return_inverse=True)
        # The nearest skin of a vertex inside may belong to an adjacent part.
        around = np.flatnonzero(parts.adjacent[index, parts.part_of_face])
        for name, array in (
            ("vertices", vertices), ("triangles", own.reshape(-1, 3)),
            ("skin", parts.skin[parts.part_of_face == index]), ("around", parts.skin[around]),
            ("rivals", parts.opponents[:, parts.part_of_face[around]]), ("outline", parts.palm_outline),
        ):  # fmt: skip
            self.register_buffer(name, torch.from_numpy(array), persistent=False)

    def forward(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor, least: float
    ) -> Contacts:
        """The vertices inside, each with every triangle that may be its nearest.

        Args:
            points: Vertices, then centres of the openings, metres.
            hand: Index of the hand of each vertex to test.
            vertex: Index of the vertex in its hand.
            least: Vertices within this distance of the skin are left out, metres.
        """
        if len(hand):
            wanted = self._far_from_skin(points, hand, vertex, least)
            hand, vertex = hand[wanted], vertex[wanted]
        if len(hand) and self.index == PALM_PART:
            wanted = self._behind(points, hand, vertex)
            hand, vertex = hand[wanted], vertex[wanted]
        if len(hand):
            wanted = self._inside(points, hand, vertex)
            hand, vertex = hand[wanted], vertex[wanted]
        if len(hand):
            return self._within_reach(points, hand, vertex)
        none = hand.new_zeros(0)
        return Contacts(none, none, none, none.new_zeros(0, 3))

    def _far_from_skin(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor, least: float
    ) -> Bool[Tensor, " query"]:
        """Mask of vertices farther than `least` from the centroids of all triangles of the skin."""
        centroids = _centroids(points, self.skin).permute(2, 1, 0).contiguous()
        return torch.cat(
            [
                _squared_gaps(centroids, of_hand, points[of_vertex, :, of_hand]).amin(dim=1)
                > least**2
                for of_hand, of_vertex in self._lots(len(self.skin), hand, vertex)
            ]
        )

    def _behind(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Bool[Tensor, " query"]:
        """Mask of vertices with a triangle of the palm in front, seen along the palm's normal.

        A point inside a closed surface has some of that surface in front in every direction. Bounding boxes
        stand for triangles, so that none is missed.
        """
        index, little, wrist = points[self.outline].mT
        across, along = index - little, index + little - 2 * wrist
        axes = torch.stack([across, along, torch.linalg.cross(across, along)], dim=1)
        seen = axes @ points.index_select(0, self.vertices).permute(2, 1, 0)
        first, second, third = (seen.index_select(2, corner) for corner in self.triangles.T)
        low = torch.minimum(torch.minimum(first, second), third)[:, :2].contiguous()
        high = torch.maximum(torch.maximum(first, second), third)
        positions = axes[hand] @ points[vertex, :, hand][..., None]
        behind = []
        for of_hand, position in self._lots(len(self.triangles), hand, positions):
            above = high.index_select(0, of_hand) >= position
            hit = (low.index_select(0, of_hand) <= position[:, :2]) & above[:, :2]
            behind.append((hit[:, 0] & hit[:, 1] & above[:, 2]).any(dim=1))
        return torch.cat(behind)

    def _inside(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Bool[Tensor, " query"]:
        """Mask of vertices with a winding number above ½; none of them is a vertex of this part."""
        surfaces = points.index_select(0, self.vertices).permute(2, 0, 1)
        queries = points[vertex, :, hand]
        numbers = winding_number(queries, hand, surfaces, self.triangles, at_once=self.at_once)
        return numbers > 0.5

    def _within_reach(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Contacts:
        """Pairs of a vertex inside and a triangle, of parts it can penetrate, that may be its nearest."""
        some, of_some = hand.unique(return_inverse=True)
        posed = points.index_select(2, some)
        centroids = _centroids(posed, self.around)
        rims = [(posed.index_select(0, c) - centroids).square_().sum(dim=1) for c in self.around.T]
        reach = torch.maximum(torch.maximum(rims[0], rims[1]), rims[2]).sqrt_().T.contiguous()
        centroids, found = centroids.permute(2, 1, 0).contiguous(), []
        for row, of_hand, of_vertex in self._lots(len(self.around), of_some, hand, vertex):
            unrelated = ~self.rivals.index_select(0, of_vertex)
            gaps = _squared_gaps(centroids, row, points[of_vertex, :, of_hand]).sqrt_()
            gaps.masked_fill_(unrelated, torch.inf)
            # The nearest point is at most as far as the nearest centroid, and no point of a triangle is
            # nearer than its centroid minus its reach.
            nearest = gaps.amin(dim=1, keepdim=True)
            possible = gaps.sub_(reach.index_select(0, row)) <= nearest
            query, face = possible.nonzero(as_tuple=True)
            part = torch.full_like(query, self.index)
            found.append(Contacts(of_hand[query], of_vertex[query], part, self.around[face]))
        return Contacts.joined(found)

    def _lots(self, width: int, *columns: Tensor) -> Iterator[tuple[Tensor, ...]]:
        """Split columns into lots of rows, at most `at_once` numbers at `width` per row."""
        lot = max(1, self.at_once // width)
        return zip(*(column.split(lot) for column in columns), strict=True)


def _centroids(
    points: Float[Tensor, "point 3 hand"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "face 3 hand"]:
    """Centroid of each triangle."""
    first, second, third = (points.index_select(0, corner) for corner in faces.T)
    return first.add_(second).add_(third).div_(3)


def _squared_gaps(
    positions: Float[Tensor, "hand 3 position"],
    hand: Int[Tensor, " query"],
    points: Float[Tensor, "query 3"],
) -> Float[Tensor, "query position"]:
    """Squared distances of points to all positions of their hands."""
    x, y, z = positions.index_select(0, hand).sub_(points[..., None]).square_().unbind(dim=1)
    return (x + y).add_(z)
