"""Non-penetration in a second-order fit: depths of vertices as residuals of a hinge (Sec. 3.2, Eq. 4).

Eq. 4 adds up depths, not their squares, so its second derivatives are zero and its minimum is a kink. As in
iteratively reweighted least squares, max(x, 0) = (x + |x|) / 2 is replaced by a parabola that touches it at
the current depth. Vertices that nearly count are included, so that a step does not push them in.
"""

from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.second_order.chain import Skeleton, chain_vertices, subtrees
from hand_recon.fitting.second_order.least_squares import Model
from hand_recon.fitting.second_order.levenberg_marquardt import Loss
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, SHAPE, Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LEVEL_ORDER
from hand_recon.knowledge.penetration.contact import Contacts
from hand_recon.knowledge.terms import NonPenetrationTerm

MARGIN: Final = 1e-3
"""Vertices that lack this much depth to count are included, metres."""

ROUNDING: Final = 1e-3
"""Distance from the kink within which the parabola no longer narrows, metres."""


class PenetrationTerm:
    """Second-order model of the non-penetration term.

    Pose blend shapes, where the hand has them, are left out of the derivatives, not of the value.

    Args:
        hand: Hand model with all vertices.
        term: The term, with its weight.
    """

    def __init__(self, hand: HandModel, term: NonPenetrationTerm) -> None:
        self._hand, self._physics, self._weight = hand, term.non_penetration, term.weight
        self._points, self._skeleton = chain_vertices(hand), Skeleton(hand)
        order = list(LEVEL_ORDER)
        self._below = subtrees()[order][:, order].to(hand.template)
        self._places = [LEVEL_ORDER.index(joint) for joint in range(1, len(LEVEL_ORDER))]

    def __call__(self, unknowns: Unknowns) -> tuple[Tensor, Tensor, Tensor]:
        """Value, gradient and curvature of each hand.

        Args:
            unknowns: The hands.
        """
        vertices = self._hand(unknowns.joint_angles, unknowns.shape).vertices
        tolerance = self._physics.tolerance
        contacts = self._physics.contacts(vertices, max(tolerance - MARGIN, 0.0))
        excess = contacts.depths(vertices) - tolerance
        rows = self.jacobian(unknowns, vertices, contacts)
        size = excess.abs().clamp(min=ROUNDING)
        slope = self._weight / 2 * (1 + excess / size)
        value = vertices.new_zeros(len(unknowns))
        value = value.index_add(0, contacts.hand, self._weight * excess.clamp(min=0))
        gradient = vertices.new_zeros(len(unknowns), COUNT)
        gradient = gradient.index_add(0, contacts.hand, slope[:, None] * rows)
        curvature = vertices.new_zeros(len(unknowns), COUNT, COUNT)
        for hand in contacts.hand.unique().tolist():
            own = contacts.hand == hand
            curvature[hand] = rows[own].mT @ (self._weight / 2 / size[own, None] * rows[own])
        return value, gradient, curvature

    def jacobian(
        self, unknowns: Unknowns, vertices: Float[Tensor, "hand vertex 3"], contacts: Contacts
    ) -> Float[Tensor, "contact unknown=61"]:
        """Derivatives of the depths by the unknowns of their hands.

        Args:
            unknowns: The hands.
            vertices: Their vertices in the hand's frame, metres.
            contacts: Pairs of a vertex and its nearest triangle.
        """
        hand, nearest = contacts.hand, contacts.weights(vertices)
        corners = torch.cat([contacts.vertex[:, None], contacts.corners], dim=1)
        shares = torch.cat([torch.ones_like(nearest[:, :1]), -nearest], dim=1)
        # The vertex minus its nearest point is again a sum over the joints.
        apart = (shares[..., None] * vertices[hand[:, None], corners]).sum(dim=1)
        normal = torch.nn.functional.normalize(apart, dim=1)
        directions = torch.einsum("ci,cijxs->cjxs", shares, self._points.shape_directions[corners])
        local = torch.einsum("ci,cijx->cjx", shares, self._points.mean[corners])
        local = local + (directions @ unknowns.shape[hand][:, None, :, None])[..., 0]
        eye = torch.eye(3).to(vertices).expand(len(unknowns), 3, 3)
        orientations, axes = self._skeleton(unknowns.joint_angles, eye)
        orientations = orientations.permute(3, 2, 0, 1)[hand]
        turned = self._below @ (orientations @ local[..., None])[..., 0]
        moment = torch.linalg.cross(turned, normal[:, None].expand_as(turned))
        by_angle = (axes.permute(3, 2, 1, 0)[hand] @ moment[..., None])[..., 0]
        found = vertices.new_zeros(len(hand), COUNT)
        found[:, ANGLES] = by_angle[:, self._places].flatten(1)
        pulled = (normal[:, None, None] @ orientations)[:, :, 0]
        found[:, SHAPE] = torch.einsum("cjx,cjxs->cs", pulled, directions)
        return found


@dataclass(frozen=True)
class WholeProblem:
    """A loss with the non-penetration term."""

    problem: Loss
    """Everything else."""
    penetration: PenetrationTerm
    """The term."""

    def __getitem__(self, hands: Tensor) -> Self:
        """The loss of some of the hands."""
        return replace(self, problem=self.problem[hands])

    def __call__(self, unknowns: Unknowns) -> Model:
        """Compute the loss with its first and second derivatives.

        Args:
            unknowns: The hands.
        """
        model = self.problem(unknowns)
        value, gradient, curvature = self.penetration(unknowns)
        return replace(
            model,
            value=model.value + value,
            gradient=model.gradient + gradient,
            curvature=model.curvature + curvature,
        )
