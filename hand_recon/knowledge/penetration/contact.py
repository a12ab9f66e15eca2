"""Vertices inside a part of the hand, and where its skin is nearest (Sec. 3.2, M and d(v) of Eq. 4)."""

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
    """Vertices inside another part of their hand, each paired with a triangle of the skin it went through."""

    hand: Int[Tensor, " contact"]
    """Which hand."""
    vertex: Int[Tensor, " contact"]
    """Which of its vertices."""
    part: Int[Tensor, " contact"]
    """The part that it is inside of."""
    corners: Int[Tensor, "contact corner=3"]
    """The triangle."""

    @classmethod
    def joined(cls, contacts: list["Contacts"]) -> "Contacts":
        """All of them in one record."""
        columns = [[getattr(some, field.name) for some in contacts] for field in fields(cls)]
        return cls(*map(torch.cat, columns))

    def where(self, chosen: Tensor) -> "Contacts":
        """Some of them, by mask or by index."""
        return Contacts(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def depths(self, vertices: Float[Tensor, "hand vertex 3"]) -> Float[Tensor, " contact"]:
        """Distance of each vertex to its triangle, metres, with gradients for both.

        The nearest point keeps its place in the triangle: moving it along would not change the distance.
        """
        triangles = vertices[self.hand[:, None], self.corners]
        nearest = (self.weights(vertices)[..., None] * triangles).sum(dim=-2)
        return (vertices[self.hand, self.vertex] - nearest).norm(dim=-1)

    @torch.no_grad()
    def weights(
        self, vertices: Float[Tensor, "hand vertex 3"]
    ) -> Float[Tensor, "contact corner=3"]:
        """Where on each triangle the point nearest to the vertex is."""
        triangles = vertices[self.hand[:, None], self.corners]
        return nearest_on_triangles(vertices[self.hand, self.vertex], triangles)


def first_of_each(
    group: Int[Tensor, " item"], value: Float[Tensor, " item"]
) -> Int[Tensor, " group"]:
    """The item with the least value in every group that has one."""
    order = value.argsort()
    count = int(group.max()) + 1 if len(group) else 0
    rank = torch.arange(len(order), device=order.device)
    first = rank.new_full((count,), len(order)).scatter_reduce_(0, group[order], rank, "amin")
    return order[first[first < len(order)]]


class PartContacts(nn.Module):
    """Finds which of some vertices are inside one closed part of the hand.

    Winding numbers cost most, so that cheaper questions come first: whether a vertex is far enough from the
    middles of the part's triangles, and for the palm, which is hollow, whether any of it is in front of the
    vertex. They change no answer.
    """

    vertices: Tensor
    triangles: Tensor
    skin: Tensor
    around: Tensor
    rivals: Tensor
    outline: Tensor

    def __init__(self, parts: ClosedParts, index: int, at_once: int) -> None:
        """Prepare a part.

        Args:
            parts: The hand's.
            index: Which of them.
            at_once: Most solid angles or distances to hold at once.
        """
        super().__init__()
        self.index, self.at_once = index, at_once
        vertices, own = np.unique(parts.faces[index], return_inverse=True)
        # A vertex inside may be nearest to the outside through the skin of a part next to this one.
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
        """Those that are inside, each with every triangle of the skin around that may be its nearest.

        Args:
            points: Vertices, then centres of the openings, metres.
            hand: Of each vertex in question.
            vertex: Which one it is.
            least: Only vertices farther than this from the skin matter, metres.
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
        """Whether each vertex is farther than `least` from the middles of all triangles of the skin."""
        middles = _middles(points, self.skin).permute(2, 1, 0).contiguous()
        return torch.cat(
            [
                _squared_gaps(middles, of_hand, points[of_vertex, :, of_hand]).amin(dim=1)
                > least**2
                for of_hand, of_vertex in self._lots(len(self.skin), hand, vertex)
            ]
        )

    def _behind(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Bool[Tensor, " query"]:
        """Whether a triangle of the palm may be in front of each vertex, as seen from where the palm faces.

        What is inside a closed surface has some of it in front in every direction. A triangle counts where
        its bounding box does, so that none is missed.
        """
        index, little, wrist = points[self.outline].mT
        across, along = index - little, index + little - 2 * wrist
        axes = torch.stack([across, along, torch.linalg.cross(across, along)], dim=1)
        seen = axes @ points.index_select(0, self.vertices).permute(2, 1, 0)
        first, second, third = (seen.index_select(2, corner) for corner in self.triangles.T)
        low = torch.minimum(torch.minimum(first, second), third)[:, :2].contiguous()
        high = torch.maximum(torch.maximum(first, second), third)
        places = axes[hand] @ points[vertex, :, hand][..., None]
        behind = []
        for of_hand, place in self._lots(len(self.triangles), hand, places):
            above = high.index_select(0, of_hand) >= place
            hit = (low.index_select(0, of_hand) <= place[:, :2]) & above[:, :2]
            behind.append((hit[:, 0] & hit[:, 1] & above[:, 2]).any(dim=1))
        return torch.cat(behind)

    def _inside(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Bool[Tensor, " query"]:
        """Whether the part winds around each vertex, which is none of its own."""
        surfaces = points.index_select(0, self.vertices).permute(2, 0, 1)
        places = points[vertex, :, hand]
        turns = winding_number(places, hand, surfaces, self.triangles, at_once=self.at_once)
        return turns > 0.5

    def _within_reach(
        self, points: Float[Tensor, "point 3 hand"], hand: Tensor, vertex: Tensor
    ) -> Contacts:
        """Pairs of a vertex inside and a triangle that may be its nearest of the rivals' skin."""
        some, of_some = hand.unique(return_inverse=True)
        posed = points.index_select(2, some)
        middles = _middles(posed, self.around)
        rims = [(posed.index_select(0, c) - middles).square_().sum(dim=1) for c in self.around.T]
        reach = torch.maximum(torch.maximum(rims[0], rims[1]), rims[2]).sqrt_().T.contiguous()
        middles, found = middles.permute(2, 1, 0).contiguous(), []
        for turn, of_hand, of_vertex in self._lots(len(self.around), of_some, hand, vertex):
            unrelated = ~self.rivals.index_select(0, of_vertex)
            gaps = _squared_gaps(middles, turn, points[of_vertex, :, of_hand]).sqrt_()
            gaps.masked_fill_(unrelated, torch.inf)
            # The nearest point is no farther than the nearest middle, and on no triangle nearer than this.
            nearest = gaps.amin(dim=1, keepdim=True)
            possible = gaps.sub_(reach.index_select(0, turn)) <= nearest
            query, face = possible.nonzero(as_tuple=True)
            part = torch.full_like(query, self.index)
            found.append(Contacts(of_hand[query], of_vertex[query], part, self.around[face]))
        return Contacts.joined(found)

    def _lots(self, width: int, *columns: Tensor) -> Iterator[tuple[Tensor, ...]]:
        """Rows of some columns in lots small enough for the memory; one empty lot where there are none."""
        lot = max(1, self.at_once // width)
        return zip(*(column.split(lot) for column in columns), strict=True)


def _middles(
    points: Float[Tensor, "point 3 hand"], faces: Int[Tensor, "face 3"]
) -> Float[Tensor, "face 3 hand"]:
    """The middle of each triangle."""
    first, second, third = (points.index_select(0, corner) for corner in faces.T)
    return first.add_(second).add_(third).div_(3)


def _squared_gaps(
    places: Float[Tensor, "hand 3 place"],
    hand: Int[Tensor, " query"],
    points: Float[Tensor, "query 3"],
) -> Float[Tensor, "query place"]:
    """Squared distances of points to all the places of their hands."""
    x, y, z = places.index_select(0, hand).sub_(points[..., None]).square_().unbind(dim=1)
    return (x + y).add_(z)
