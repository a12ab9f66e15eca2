"""Hand physics: a loss on parts of the hand that are inside other parts (Sec. 3.2, Eq. 4)."""

from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.closed_parts import closed_parts, geodesic_distances
from hand_recon.knowledge.penetration.contact import Contacts, PartContacts, first_of_each
from hand_recon.knowledge.penetration.part_bounds import PartBounds
from hand_recon.knowledge.penetration.winding_number import SOLID_ANGLES_AT_ONCE

_HANDS_AT_ONCE: Final = 64
"""Number of hands processed at once, which bounds the memory."""


class NonPenetration(nn.Module):
    """Σ max(d(v) − d_tol, 0) over the vertices inside another part of the hand, for any batch shape.

    The surface is cut into the palm and fourteen phalanges, each closed (`ClosedParts`). A vertex is inside
    if it has a winding number above ½ for a part that is neither its own nor adjacent to its own; adjacent
    parts are left out because skinning folds the skin between them. d(v) is the distance of the vertex to the
    skin of that part and of its adjacent parts, again without those adjacent to the vertex's own part. A
    vertex whose nearest point is within the geodesic distance `geodesic` on the surface at rest is in a fold
    and does not count. Of several parts around a vertex, the one in which it is deepest counts. The inside
    test and the choice of the nearest triangle have no gradient; the distance has.
    """

    centres: Tensor
    geodesic_distances: Tensor

    def __init__(
        self,
        hand: HandModel,
        *,
        geodesic: float = 0.02,
        tolerance: float = 0.006,
        at_once: int = SOLID_ANGLES_AT_ONCE,
    ) -> None:
        """Precompute everything that does not depend on the pose.

        Args:
            hand: The hand model.
            geodesic: Geodesic distance at rest up to which a vertex and its nearest skin are a fold, metres.
            tolerance: d_tol, the depth that soft tissue allows, metres.
            at_once: Most solid angles or distances in memory at once; does not change the value.

        Raises:
            ValueError: A length is negative, or the hand's surface is not closed.
        """
        super().__init__()
        if geodesic < 0 or tolerance < 0:
            raise ValueError(
                "geodesic and tolerance are lengths in metres and cannot be negative, "
                f"found {geodesic} and {tolerance}."
            )
        self.geodesic, self.tolerance, self.at_once = geodesic, tolerance, at_once
        parts = closed_parts(hand)
        template = hand.template.double().cpu().numpy()
        for name, array in (
            ("centres", parts.centres),
            ("geodesic_distances", geodesic_distances(template, parts.skin)),
        ):
            self.register_buffer(name, torch.from_numpy(array).float(), persistent=False)
        self.bounds = PartBounds(parts)
        self.parts = nn.ModuleList(
            PartContacts(parts, index, at_once) for index in range(len(parts.faces))
        )

    def forward(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch"]:
        """The loss of each hand, metres.

        Args:
            vertices: Metres, in any frame.
        """
        hands = vertices.reshape(-1, *vertices.shape[-2:])
        contacts = self.contacts(hands.detach(), self.tolerance)
        excess = contacts.depths(hands) - self.tolerance
        losses = hands.new_zeros(len(hands)).index_add(0, contacts.hand, excess)
        return losses.view(vertices.shape[:-2])

    @torch.no_grad()
    def depths(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch vertex"]:
        """d(v) of every vertex, metres, without gradient; zero for vertices inside no other part.

        Args:
            vertices: Metres, in any frame.
        """
        hands = vertices.reshape(-1, *vertices.shape[-2:])
        contacts = self.contacts(hands, 0.0)
        depths = torch.zeros_like(hands[..., 0])
        depths[contacts.hand, contacts.vertex] = contacts.depths(hands)
        return depths.view(vertices.shape[:-1])

    @torch.no_grad()
    def contacts(self, hands: Float[Tensor, "hand vertex 3"], least: float) -> Contacts:
        """All vertices deeper than `least` inside another part, each with its nearest triangle.

        Args:
            hands: Vertices of each hand, metres.
            least: Smallest depth that is looked for, metres; the larger, the faster.
        """
        found = [self._contacts_of_some(some, least) for some in hands.split(_HANDS_AT_ONCE)]
        return Contacts.joined(
            [
                replace(some, hand=some.hand + _HANDS_AT_ONCE * number)
                for number, some in enumerate(found)
            ]
        )

    def _contacts_of_some(self, hands: Float[Tensor, "hand vertex 3"], least: float) -> Contacts:
        points = torch.cat([hands, self.centres.to(hands) @ hands], dim=1)
        hand, vertex, counts = self.bounds(points.transpose(0, 1).contiguous())
        queries = zip(self.parts, hand.split(counts), vertex.split(counts), strict=True)
        points = points.permute(1, 2, 0).contiguous()
        pairs = Contacts.joined([part(points, *query, least) for part, *query in queries])
        lots = torch.arange(len(pairs.hand), device=hands.device).split(self.at_once)
        depths = torch.cat([pairs.where(lot).depths(hands) for lot in lots])
        point = pairs.hand * hands.shape[1] + pairs.vertex
        nearest = first_of_each(point * len(self.parts) + pairs.part, depths)
        contacts, depths = pairs.where(nearest), depths[nearest]
        corners = self.geodesic_distances[contacts.vertex[:, None], contacts.corners].to(hands)
        far = (corners * contacts.weights(hands)).sum(dim=1) > self.geodesic
        counting = ((depths > least) & far).nonzero()[:, 0]
        # Of several parts around a vertex, the one in which it is deepest counts.
        deepest = first_of_each(point[nearest][counting], -depths[counting])
        return contacts.where(counting[deepest])
