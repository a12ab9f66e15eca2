"""Second-order fit of a batch of hands: starts, their selection, and the last steps (Sec. 3.4)."""

from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.finger_poses import FingerPoses, Seen
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import (
    FIRST_DAMPING,
    Limits,
    Reached,
    minimize,
)
from hand_recon.fitting.second_order.penetration import PenetrationTerm, WholeProblem
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.fitting.start import Start
from hand_recon.knowledge.terms import NonPenetrationTerm
from hand_recon.schema import HandParameters

ROUNDS: Final = ((8, 3), (4, 4), (2, 6), (1, 10))
"""Starts per hand that are kept, and steps that each of them then takes, with centred angles."""

LAST: Final = Limits(iterations=15, tolerance=1e-5)
"""Steps of the best start on the loss itself."""

APART: Final = Limits(iterations=10, tolerance=1e-3, largest_angle=0.2)
"""Steps of hands that penetrate themselves, with the non-penetration term."""


@dataclass(frozen=True)
class SecondOrder:
    """What a second-order fit of one hand model on one loss needs, computed once for all batches."""

    objective: Objective
    """The loss, with its data term in the last stage."""
    projection: LandmarkProjection
    """Landmarks with derivatives."""
    fingers: FingerPoses
    """Start poses of the fingers."""

    @classmethod
    def of(cls, objective: Objective) -> Self:
        """Prepare fits on a loss.

        Args:
            objective: The loss, with its data term in the last stage.
        """
        hand = objective.hand
        return cls(objective, LandmarkProjection(hand), FingerPoses(hand.landmarks_only()))

    @torch.no_grad()
    def __call__(
        self, observation: Observation, palms: Start | None, further: Start | None
    ) -> HandParameters:
        """Fit every hand of a batch.

        Args:
            observation: The landmarks.
            palms: Placements of the palm, batch × start; the fingers are looked up.
            further: Starts that are taken as they are, batch × start.
        """
        prior, data_term = self.objective.prior, self.objective.data_term
        centred = Problem.of(
            self.projection, PriorTerms(prior, centred=True), data_term, observation
        )
        best = self._selected(centred, self._starts(centred, palms, further))
        plain = replace(centred, terms=PriorTerms(prior))
        found = minimize(plain, best.unknowns, LAST, best.damping)
        return self._apart(plain, found.unknowns).parameters(plain.inverse)

    def _starts(self, problem: Problem, palms: Start | None, further: Start | None) -> Unknowns:
        """All starts, those of each hand behind each other."""
        found = []
        if palms is not None:
            several = problem[_rows(len(problem.target), palms.translation.shape[1])]
            seen = Seen.of(several.observation)
            placed = Unknowns.of_start(palms.flat(), seen.intrinsics)
            found += [self.fingers.nearest(placed, seen, second=second) for second in (False, True)]
        if further is not None:
            several = problem[_rows(len(problem.target), further.translation.shape[1])]
            found.append(Unknowns.of_start(further.flat(), several.observation.intrinsics))
        return Unknowns.beside(found, len(problem.target))

    def _selected(self, problem: Problem, start: Unknowns) -> Reached:
        """The best start of each hand after the rounds."""
        hands = len(problem.target)
        rows = _rows(hands, len(start) // max(hands, 1))
        value = problem[rows](start).value
        here = Reached(start, value, torch.full_like(value, FIRST_DAMPING))
        for count, iterations in ROUNDS:
            kept = _least(here.value, hands, count)
            here, rows = here[kept], rows[kept]
            here = minimize(problem[rows], here.unknowns, Limits(iterations), here.damping)
        return here

    def _apart(self, problem: Problem, found: Unknowns) -> Unknowns:
        """Move parts of hands out of each other, if the prior has a term for that."""
        objective = self.objective
        terms = [
            term for term in objective.prior.terms.values() if isinstance(term, NonPenetrationTerm)
        ]
        if not terms or not objective.with_non_penetration:
            return found
        vertices = objective.hand(found.joint_angles, found.shape).vertices
        hit = (terms[0](found.parameters(problem.inverse), vertices) > 0).nonzero()[:, 0]
        if not len(hit):
            return found
        whole = WholeProblem(problem[hit], PenetrationTerm(objective.hand, terms[0]))
        return found.put(hit, minimize(whole, found[hit], APART).unknowns)


def _rows(hands: int, count: int) -> Int[Tensor, " start"]:
    """Index of the hand of each start."""
    return torch.arange(hands).repeat_interleave(count)


def _least(value: Float[Tensor, " start"], hands: int, count: int) -> Int[Tensor, " kept"]:
    """Indices of the starts of least loss of each hand, in the order of the hands.

    Args:
        value: Loss of every start; those of a hand are behind each other.
        hands: Number of hands.
        count: Starts to keep per hand, if there are so many.
    """
    each = len(value) // max(hands, 1)
    by_hand = value.nan_to_num(torch.inf).view(hands, each)
    kept = by_hand.argsort(dim=1, stable=True)[:, :count].sort(dim=1).values
    return (kept + each * torch.arange(hands)[:, None]).flatten()
