"""The nearest plausible hand: a fit to the audited hand with the whole prior as a constraint (decision 82).

Ranges of motion and functional anatomy are a stiff hinge in the fit, and the projection onto them afterwards
is exact: bends are clamped first, then the splays that they leave. Hands that penetrate themselves are fitted
again, with ever stiffer non-penetration. Where that ends in a minimum that still penetrates, fingers are
opened by the least share that frees them. The shape stays that of the audited hand.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.second_order.levenberg_marquardt import Limits as Steps
from hand_recon.fitting.second_order.levenberg_marquardt import Reached, minimize
from hand_recon.fitting.second_order.penetration import PenetrationTerm, WholeProblem
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, FINGERS
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import NonPenetrationTerm, RangeOfMotionTerm
from hand_recon.plausibility.findings import Knowledge
from hand_recon.plausibility.point_fit import PointFitter, PointProblem
from hand_recon.plausibility.point_start import rotation_between
from hand_recon.schema import HandParameters

MARGIN: Final = 2e-4
"""Depth that repaired hands stay below the tolerance, metres."""

STIFFNESS: Final = (2e4, 2e5, 2e6)
"""Weights of non-penetration, per metre, in turn."""

RANGE_WEIGHT: Final = 2e4
"""λ₁, per squared radian."""

APART: Final = Steps(iterations=15, tolerance=1e-4, largest_angle=0.2)

GREATEST_SHAPE: Final = 4.0
"""Greatest shape coefficient of a repaired hand, standard deviations."""

SHARES: Final = 12
"""Steps from a pose to the open hand in which fingers are opened."""


class Repair:
    """Repair of hands of one hand model.

    Args:
        hand: Hand model.
        knowledge: Ranges, functional anatomy and tolerance of penetration.
    """

    def __init__(self, hand: HandModel, knowledge: Knowledge) -> None:
        self._hand, self._light = hand, hand.landmarks_only()
        self._knowledge = knowledge
        ranges = RangeOfMotionTerm(
            hand, weight=RANGE_WEIGHT, ranges=knowledge.ranges, anatomy=knowledge.anatomy
        )
        self._fitter = PointFitter(hand, Prior({"range_of_motion": ranges}))
        self._allowed = knowledge.tolerance - MARGIN
        self._apart_term = NonPenetrationTerm(hand, tolerance=self._allowed - 2 * MARGIN)

    @torch.no_grad()
    def __call__(
        self, hands: HandParameters, target: Float[Tensor, "hand landmark=21 3"]
    ) -> HandParameters:
        """Find the nearest plausible hands.

        Args:
            hands: Right hands with a pose.
            target: Landmarks to stay near: the given ones, or those of `hands`; NaN where missing.
        """
        kept = hands.shape.clamp(-GREATEST_SHAPE, GREATEST_SHAPE)
        start = replace(hands, joint_angles=self.inside(hands.joint_angles), shape=kept)
        problem = self._fitter.problem(target).with_shape(kept)
        found = self._fitter.fitted(problem, start).parameters
        best = self._nearer(start, self._settled(found, target), target)
        return self._apart(problem, best, target)

    def inside(
        self, angles: Float[Tensor, "hand joint=15 axis=3"]
    ) -> Float[Tensor, "hand joint=15 axis=3"]:
        """The nearest angles inside the ranges as functional anatomy leaves them, radians.

        Args:
            angles: Joint angles, radians.
        """
        inside = self._knowledge.ranges.clamp(angles)
        return self._knowledge.anatomy.refine(self._knowledge.ranges, inside).clamp(inside)

    def depth(self, hands: HandParameters) -> Float[Tensor, " hand"]:
        """Greatest depth of a vertex inside another part of the hand, metres."""
        vertices = self._hand(hands.joint_angles, hands.shape).vertices
        return self._apart_term.non_penetration.depths(vertices).amax(dim=1)

    def _settled(self, hands: HandParameters, target: Tensor) -> HandParameters:
        """Hands with their angles inside the ranges, rotated and moved as near to the target as they come."""
        angles = self.inside(hands.joint_angles)
        own = self._light(angles, hands.shape).landmarks
        given = target.isfinite().all(dim=-1)
        rotation = rotation_between(own, target, given)
        weight = given.to(own)[..., None]
        apart = (target.nan_to_num(0.0) - own @ rotation.mT) * weight
        offset = apart.sum(dim=1) / weight.sum(dim=1).clamp(min=1)
        return HandParameters(angles, hands.shape, rotation, offset)

    def _distance(self, hands: HandParameters, target: Tensor) -> Float[Tensor, " hand"]:
        """Mean distance of the landmarks to the target, metres."""
        return (self._light.to_camera(hands).landmarks - target).norm(dim=-1).nanmean(dim=1)

    def _nearer(
        self, first: HandParameters, second: HandParameters, target: Tensor
    ) -> HandParameters:
        """The nearer one of two hands to each target."""
        first = self._settled(first, target)
        better = self._distance(second, target) < self._distance(first, target)
        return _where(better, second, first)

    def _apart(
        self, problem: PointProblem, hands: HandParameters, target: Tensor
    ) -> HandParameters:
        """Move parts of hands out of each other."""
        for weight in STIFFNESS:
            rows = (self.depth(hands) > self._allowed).nonzero()[:, 0]
            if not len(rows):
                return hands
            self._apart_term.weight = weight
            whole = WholeProblem(problem[rows], PenetrationTerm(self._hand, self._apart_term))
            some = hands.select(rows)
            start = Unknowns(
                some.joint_angles, some.root_rotation, torch.zeros(len(rows), 3), some.shape
            )
            found = minimize(whole, Reached.at(whole, start), APART).unknowns
            moved = replace(
                some, joint_angles=found.joint_angles, root_rotation=found.root_rotation
            )
            hands = _put(hands, rows, self._settled(moved, target[rows]))
        for row in (self.depth(hands) > self._allowed).nonzero()[:, 0].tolist():
            index = torch.tensor([row])
            opened = self._opened(hands.select(index), target[index])
            hands = _put(hands, index, opened)
        return hands

    def _opened(self, hand: HandParameters, target: Tensor) -> HandParameters:
        """One hand with fingers opened until it no longer penetrates itself: the way that moves it least."""
        best, least = None, torch.inf
        for fingers in _groups():
            mask = fingers[:, None].expand(15, 3)
            share = torch.linspace(0, 1, SHARES + 1)[1:, None, None] * mask
            angles = self.inside(hand.joint_angles * (1 - share))
            several = HandParameters(
                angles, hand.shape.expand(SHARES, -1), hand.root_rotation.expand(SHARES, -1, -1),
                hand.translation.expand(SHARES, -1),
            )  # fmt: skip
            free = (self.depth(several) <= self._allowed).nonzero()[:, 0]
            if not len(free):
                continue
            chosen = self._settled(several.select(free[:1]), target)
            distance = float(self._distance(chosen, target))
            if distance < least:
                best, least = chosen, distance
        return hand if best is None else best


def _groups() -> Iterator[Bool[Tensor, " joint=15"]]:
    """Masks of the joints of one finger, of two, and of all."""
    for count in (1, 2, len(FINGERS)):
        for fingers in combinations(FINGERS, count):
            yield torch.tensor([joint.split()[0] in fingers for joint in ARTICULATED])


def _where(mask: Tensor, first: HandParameters, second: HandParameters) -> HandParameters:
    """The first hands where a mask is true, the second ones elsewhere."""
    wide = mask[:, None, None]
    return HandParameters(
        torch.where(wide, first.joint_angles, second.joint_angles),
        torch.where(mask[:, None], first.shape, second.shape),
        torch.where(wide, first.root_rotation, second.root_rotation),
        torch.where(mask[:, None], first.translation, second.translation),
    )


def _put(hands: HandParameters, rows: Tensor, some: HandParameters) -> HandParameters:
    """Hands with some of them replaced."""
    return HandParameters(
        hands.joint_angles.index_put((rows,), some.joint_angles),
        hands.shape.index_put((rows,), some.shape),
        hands.root_rotation.index_put((rows,), some.root_rotation),
        hands.translation.index_put((rows,), some.translation),
    )
