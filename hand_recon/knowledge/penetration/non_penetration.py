"""Hand physics: no part of the hand is inside another one (Sec. 3.2, Eq. 4)."""

from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.closed_parts import closed_parts, geodesic_distances
from hand_recon.knowledge.penetration.contact import Contacts, PartContacts, first_of_each
from hand_recon.knowledge.penetration.part_bounds import PartBounds
from hand_recon.knowledge.penetration.winding_number import SOLID_ANGLES_AT_ONCE

_HANDS_AT_ONCE: Final = 64
"""Hands whose bounds are compared at once."""


class NonPenetration(nn.Module):
    """Σ max(d(v) − d_tol, 0) over the vertices inside another part of the hand, for any batch shape.

    The surface is cut into the palm and fourteen phalanges, each closed (`ClosedParts`). A vertex is inside
    when a part winds around it that is neither its own nor next to its own: where parts meet, skinning folds
    the skin. d(v) is its distance to the skin of that part and of those next to it, again without those next
    to its own; if the nearest point is within `geodesic` along the surface at rest, it is a fold, too. Inside
    two parts, the deeper counts. The inside test and the choice of the nearest triangle have no gradient; the
    distance has.
    """

    centres: Tensor
    ways: Tensor

    def __init__(
        self,
        hand: HandModel,
        *,
        geodesic: float = 0.02,
        tolerance: float = 0.006,
        at_once: int = SOLID_ANGLES_AT_ONCE,
    ) -> None:
        """Precompute all that does not depend on the pose.

        Args:
            hand: The hand whose vertices are judged.
            geodesic: A vertex this near, along the surface at rest, to the skin it went through is in a fold,
                metres.
            tolerance: d_tol, by which flesh gives way, metres.
            at_once: Most solid angles or distances to hold at once; bounds the memory, not the value.

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
            ("ways", geodesic_distances(template, parts.skin)),
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
        """d(v) of every vertex inside another part and zero of the others, metres, without gradient."""
        hands = vertices.reshape(-1, *vertices.shape[-2:])
        contacts = self.contacts(hands, 0.0)
        depths = torch.zeros_like(hands[..., 0])
        depths[contacts.hand, contacts.vertex] = contacts.depths(hands)
        return depths.view(vertices.shape[:-1])

    @torch.no_grad()
    def penetrates(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Bool[Tensor, "*batch"]:
        """Whether any vertex is deeper inside than d_tol; PR is the share of hands of which that is true."""
        return self(vertices) > 0

    @torch.no_grad()
    def contacts(self, hands: Float[Tensor, "hand vertex 3"], least: float) -> Contacts:
        """Every vertex deeper than `least` inside another part, with the triangle nearest to it.

        Args:
            hands: Metres.
            least: Metres. The larger, the faster.
        """
        found = [self._contacts_of_some(some, least) for some in hands.split(_HANDS_AT_ONCE)]
        return Contacts.joined(
            [
                replace(some, hand=some.hand + _HANDS_AT_ONCE * turn)
                for turn, some in enumerate(found)
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
        place = pairs.hand * hands.shape[1] + pairs.vertex
        nearest = first_of_each(place * len(self.parts) + pairs.part, depths)
        contacts, depths = pairs.where(nearest), depths[nearest]
        ways = self.ways[contacts.vertex[:, None], contacts.corners].to(hands)
        far = (ways * contacts.weights(hands)).sum(dim=1) > self.geodesic
        counting = ((depths > least) & far).nonzero()[:, 0]
        # A vertex inside two parts at once is as deep as in the deeper one.
        deepest = first_of_each(place[nearest][counting], -depths[counting])
        return contacts.where(counting[deepest])
