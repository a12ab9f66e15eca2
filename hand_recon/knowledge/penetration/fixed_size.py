"""Hand physics in lists of fixed length: nothing waits for a GPU, and one graph is compiled (Eq. 4).

The definition, the parts and the tests are those of `NonPenetration`; lists have places for more vertices
than any batch of hands was found to need, and what had no place is counted (decision 99).
"""

from dataclasses import replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.closed_parts import PALM_PART, closed_parts
from hand_recon.knowledge.penetration.contact import Contacts
from hand_recon.knowledge.penetration.fixed_tables import PartPlanes, closed_rows, skin_rows
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.penetration.places import LeftOut, Places, Queries
from hand_recon.knowledge.penetration.surface_distance import nearest_on_triangles
from hand_recon.knowledge.penetration.winding_number import turns, winding_number

AT_ONCE: Final = 1 << 22
"""Most solid angles or distances in memory at once: about 180 MB in single precision."""


class FixedSizeNonPenetration(NonPenetration):
    """`NonPenetration` without a length that depends on the poses: the same value and gradient.

    Of several vertices for one place, the one that may be deeper has it.
    """

    closed: Tensor
    skin_of_phalanx: Tensor
    skin_of_palm: Tensor
    skin: Tensor
    part_of_face: Tensor
    adjacent: Tensor
    opponents: Tensor

    def __init__(
        self,
        hand: HandModel,
        *,
        geodesic: float = 0.02,
        tolerance: float = 0.006,
        at_once: int = AT_ONCE,
        places: Places | None = None,
        everywhere: bool = True,
    ) -> None:
        """Precompute everything that does not depend on the pose.

        Args:
            hand: The hand model.
            geodesic: Geodesic distance at rest up to which a vertex and its nearest skin are a fold, metres.
            tolerance: d_tol, the depth that soft tissue allows, metres.
            at_once: Most solid angles or distances in memory at once, in lists of fixed length; does not
                change the value.
            places: Places in the lists; none for the measured numbers.
            everywhere: False leaves hands on other devices than CUDA's to `NonPenetration`, which is faster
                on a processor.

        Raises:
            ValueError: A length is negative, or the hand's surface is not closed.
        """
        super().__init__(hand, geodesic=geodesic, tolerance=tolerance)
        self.places, self.everywhere = places or Places(), everywhere
        self.fixed_at_once = at_once
        parts = closed_parts(hand)
        palm = np.flatnonzero(parts.part_of_face == PALM_PART)[None]
        for name, array in (
            ("closed", closed_rows(parts)), ("skin_of_phalanx", skin_rows(parts)), ("skin_of_palm", palm),
            ("skin", parts.skin), ("part_of_face", parts.part_of_face), ("adjacent", parts.adjacent),
            ("opponents", parts.opponents),
        ):  # fmt: skip
            self.register_buffer(name, torch.from_numpy(array), persistent=False)
        self.planes = PartPlanes(parts)
        self.left_out = LeftOut()

    def forward(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch"]:
        """The loss of each hand, metres.

        Args:
            vertices: Metres, in any frame.
        """
        if self._by_pose(vertices):
            return super().forward(vertices)
        hands = vertices.reshape(-1, *vertices.shape[-2:])
        contacts, counting = self.fixed_contacts(hands.detach(), self.tolerance)
        excess = _depths(hands, contacts, counting) - self.tolerance
        excess = torch.where(counting, excess, torch.zeros_like(excess))
        losses = hands.new_zeros(len(hands)).index_add(0, contacts.hand, excess)
        return losses.view(vertices.shape[:-2])

    @torch.no_grad()
    def depths(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch vertex"]:
        """d(v) of every vertex, metres, without gradient; zero for vertices inside no other part.

        Shallow vertices count here, too, and all lists are as long as the first.

        Args:
            vertices: Metres, in any frame.
        """
        if self._by_pose(vertices):
            return super().depths(vertices)
        hands = vertices.reshape(-1, *vertices.shape[-2:])
        contacts, counting = self.fixed_contacts(hands, 0.0)
        depths = torch.zeros_like(hands[..., 0])
        place = contacts.hand * hands.shape[1] + contacts.vertex
        found = _depths(hands, contacts, counting)
        return depths.view(-1).scatter_reduce(0, place, found, "amax").view(vertices.shape[:-1])

    def _by_pose(self, vertices: Tensor) -> bool:
        """True where lists of fixed length are not wanted, or there is no hand to make them of."""
        return not ((self.everywhere or vertices.is_cuda) and vertices.numel())

    @torch.no_grad()
    def fixed_contacts(
        self, hands: Float[Tensor, "hand vertex 3"], least: float
    ) -> tuple[Contacts, Bool[Tensor, " contact"]]:
        """Places for vertices deeper than `least` inside another part, and the mask of those that are filled.

        Args:
            hands: Vertices of each hand, metres.
            least: Smallest depth that is looked for, metres; zero needs longer lists.
        """
        places = self.places
        if least == 0:
            places = replace(places, tested=places.candidates, inside=places.candidates)
        points = torch.cat([hands, self.centres.to(hands) @ hands], dim=1)
        inside, left_out = self._inside(points, least, places)
        contacts, depths, missed = self._nearest(points, inside, places.triangles)
        self.left_out.add([*left_out, missed.sum()], len(hands))
        corners = self.geodesic_distances[contacts.vertex[:, None], contacts.corners].to(hands)
        far = (corners * contacts.weights(hands)).sum(dim=1) > self.geodesic
        counting = (inside.bound > 0) & (depths > least) & far
        place = contacts.hand * hands.shape[1] + contacts.vertex
        return contacts, counting & _deepest_of_each(place, depths, counting, hands[..., 0].numel())

    def _inside(
        self, points: Float[Tensor, "hand point 3"], least: float, places: Places
    ) -> tuple[Queries, list[Int[Tensor, ""]]]:
        """Places for vertices inside another part, and the number that had none in each list so far."""
        margins = self.planes(points)
        centroids = points[:, self.skin].sum(dim=2) / 3
        tested, without = [], [margins.new_zeros((), dtype=torch.int64) for _ in range(2)]
        for first, rows, winding in (
            (PALM_PART, self.skin_of_palm, self._windings_of_palm),
            (PALM_PART + 1, self.skin_of_phalanx, self._windings_of_phalanges),
        ):
            of_parts = margins[..., first : first + len(rows)]
            near = Queries.all_pairs(of_parts, first)
            candidates = near.deepest(places.of("candidates", len(points)))
            gaps = torch.cat(
                [
                    _squared_gap(points, centroids, lot, rows[lot.part - first])
                    for lot in candidates.lots(self.fixed_at_once // rows.shape[1])
                ]
            )
            # The depth is no larger than the distance to any centroid of the part's skin.
            deep = candidates.bounded(torch.where(gaps > least**2, gaps, torch.zeros_like(gaps)))
            kept = deep.deepest(places.of("tested", len(points)))
            without[0] += near.filled() - candidates.filled()
            without[1] += deep.filled() - kept.filled()
            tested.append(kept.bounded((winding(points, kept) > 0.5) * kept.bound))
        enclosed = Queries.joined(*tested)
        inside = enclosed.deepest(places.of("inside", len(points)))
        return inside, [*without, enclosed.filled() - inside.filled()]

    def _windings_of_palm(
        self, points: Float[Tensor, "hand point 3"], queries: Queries
    ) -> Float[Tensor, " place"]:
        """Winding number of the palm at each vertex."""
        palm = self.parts[PALM_PART]
        surfaces = points.index_select(1, palm.get_buffer("vertices"))
        positions = points[queries.hand, queries.vertex]
        triangles = palm.get_buffer("triangles")
        return winding_number(
            positions, queries.hand, surfaces, triangles, at_once=self.fixed_at_once
        )

    def _windings_of_phalanges(
        self, points: Float[Tensor, "hand point 3"], queries: Queries
    ) -> Float[Tensor, " place"]:
        """Winding number of its phalanx at each vertex."""
        found = []
        for lot in queries.lots(self.fixed_at_once // self.closed.shape[1]):
            corners = points[lot.hand[:, None, None], self.closed[lot.part - 1]]
            rays = corners - points[lot.hand, lot.vertex][:, None, None]
            found.append(turns(*rays.permute(2, 3, 1, 0)))
        return torch.cat(found)

    def _nearest(
        self, points: Float[Tensor, "hand point 3"], inside: Queries, triangles: int
    ) -> tuple[Contacts, Float[Tensor, " place"], Bool[Tensor, " place"]]:
        """Nearest triangle and depth of each vertex, and mask of vertices of which a nearer one was left out.

        The triangles are those of `PartContacts`, in the order of a lower bound of their distance. None is
        missed if the first that had no place cannot be nearer than the nearest that had one.
        """
        corners = points[:, self.skin]
        centroids = corners.sum(dim=2) / 3
        reach = (corners - centroids[:, :, None]).square().sum(dim=-1).amax(dim=-1).sqrt()
        found = [
            self._nearest_of_some(points, centroids, reach, lot, triangles)
            for lot in inside.lots(self.fixed_at_once // self.skin.shape[0])
        ]
        depths, nearest, missed = (torch.cat(column) for column in zip(*found, strict=True))
        contacts = Contacts(inside.hand, inside.vertex, inside.part, self.skin[nearest])
        return contacts, depths, missed & (inside.bound > 0)

    def _nearest_of_some(
        self, points: Tensor, centroids: Tensor, reach: Tensor, lot: Queries, triangles: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Depth, index of the nearest triangle, and mask of vertices for which another one may be nearer."""
        positions = points[lot.hand, lot.vertex]
        gaps = (centroids.index_select(0, lot.hand) - positions[:, None]).square().sum(dim=-1)
        lower = gaps.sqrt() - reach.index_select(0, lot.hand)
        around = self.adjacent[lot.part] & self.opponents[lot.vertex]
        lower = lower.masked_fill(~around.index_select(1, self.part_of_face), torch.inf)
        lower, faces = lower.topk(min(triangles + 1, lower.shape[1]), dim=1, largest=False)
        asked = faces[:, :-1]
        corners = points[lot.hand[:, None, None], self.skin[asked]]
        weights = nearest_on_triangles(positions[:, None].expand_as(corners[:, :, 0]), corners)
        nearest = (weights[..., None] * corners).sum(dim=-2)
        depths = (positions[:, None] - nearest).norm(dim=-1)
        depths = depths.masked_fill(lower[:, :-1] == torch.inf, torch.inf)
        depth, best = depths.min(dim=1)
        return depth, asked.gather(1, best[:, None])[:, 0], lower[:, -1] < depth


def _squared_gap(
    points: Float[Tensor, "hand point 3"],
    centroids: Float[Tensor, "hand face 3"],
    queries: Queries,
    faces: Int[Tensor, "place some"],
) -> Float[Tensor, " place"]:
    """Squared distance of each vertex to the nearest centroid of some triangles of its hand."""
    positions = points[queries.hand, queries.vertex]
    around = centroids[queries.hand[:, None], faces]
    return (around - positions[:, None]).square().sum(dim=-1).amin(dim=1)


def _deepest_of_each(
    place: Int[Tensor, " contact"],
    depths: Float[Tensor, " contact"],
    counting: Bool[Tensor, " contact"],
    count: int,
) -> Bool[Tensor, " contact"]:
    """Mask of one contact of each vertex, the deepest that counts; of equally deep ones the first.

    Args:
        place: Number of each contact's vertex.
        depths: Depth of each contact.
        counting: Contacts that count.
        count: Number of vertices.
    """
    shown = torch.where(counting, depths, torch.zeros_like(depths))
    deepest = shown.new_zeros(count).scatter_reduce(0, place, shown, "amax")
    order = torch.arange(len(place), device=place.device)
    number = torch.where(counting & (depths == deepest[place]), order, len(place))
    first = number.new_full((count,), len(place)).scatter_reduce(0, place, number, "amin")
    return first[place] == order


def _depths(
    hands: Float[Tensor, "hand vertex 3"], contacts: Contacts, counting: Bool[Tensor, " contact"]
) -> Float[Tensor, " contact"]:
    """Distance of each vertex to its triangle, metres, with gradients; zero without where none counts."""
    triangles = hands[contacts.hand[:, None], contacts.corners]
    weights = contacts.weights(hands)
    weights = torch.where(counting[:, None], weights, torch.zeros_like(weights))
    nearest = (weights[..., None] * triangles).sum(dim=-2)
    gaps = hands[contacts.hand, contacts.vertex] - nearest
    return torch.where(counting[:, None], gaps, torch.zeros_like(gaps)).norm(dim=-1)
