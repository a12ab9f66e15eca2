"""Second-order fit of a batch of hands: starts, their selection, and the last steps (Sec. 3.4)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Self, cast

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.data_weights import is_likelihood
from hand_recon.fitting.second_order.finger_poses import FingerPoses, Seen
from hand_recon.fitting.second_order.landmark_covariance import (
    Minimum,
    mixed_covariance,
)
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import (
    Limits,
    Reached,
    minimize,
)
from hand_recon.fitting.second_order.minima import Minima
from hand_recon.fitting.second_order.penetration import PenetrationTerm, WholeProblem
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.selection import (
    all_but,
    is_repeated,
    least,
    rows_of,
    unlike,
)
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.fitting.start import Start
from hand_recon.knowledge.terms import NonPenetrationTerm
from hand_recon.schema import HandParameters
from hand_recon.uncertainty.covariance_correction import CovarianceCorrection


@dataclass(frozen=True)
class Round:
    """Some steps of the best starts of each hand."""

    starts: int
    """Starts per hand that are kept for it."""
    steps: int
    """Steps of each of them."""
    look_up: bool = False
    """True if two more starts follow from looking the fingers up with the best start's palm."""


ROUNDS: Final = (Round(8, 2), Round(3, 3, look_up=True), Round(4, 4))
"""Selection of the starts, with centred angles; those after the last round stand for all minima."""

QUICK: Final = (Round(2, 3),)
"""Selection among few starts, of which one is near the hand, such as that of the frame before."""

FINAL: Final = Round(2, 3)
"""Selection of one start among them."""

LAST: Final = Limits(iterations=25, tolerance=1e-5)
"""Steps of the best start on the loss itself."""

APART: Final = Limits(iterations=8, tolerance=1e-3, largest_angle=0.2)
"""Steps of hands that penetrate themselves, with the non-penetration term."""


@dataclass(frozen=True)
class SecondOrder:
    """Second-order fit of one hand model on one loss, with what is computed once for all batches."""

    objective: Objective
    """The loss, with its data term in the last stage."""
    projection: LandmarkProjection
    """Landmarks with derivatives by all unknowns."""
    free: LandmarkProjection
    """Landmarks with derivatives by the unknowns that the ranges do not fix."""
    fingers: FingerPoses | None
    """Start poses of the fingers; None for starts as they are."""
    correction: CovarianceCorrection | None = None
    """Correction of the landmarks' covariances; None for those of Laplace's approximation."""

    @classmethod
    def of(
        cls,
        objective: Objective,
        *,
        finger_table: bool = True,
        correction: CovarianceCorrection | None = None,
    ) -> Self:
        """Prepare fits on a loss.

        Args:
            objective: The loss, with its data term in the last stage.
            finger_table: Whether fingers of the starts are looked up in a table of natural poses.
            correction: Correction of the landmarks' covariances; None for those of Laplace's approximation.
        """
        hand = objective.hand
        free = PriorTerms(objective.prior).free()
        return cls(
            objective,
            LandmarkProjection(hand),
            LandmarkProjection(hand, free),
            FingerPoses(hand.landmarks_only()) if finger_table else None,
            correction,
        )

    @torch.no_grad()
    def __call__(
        self, observation: Observation, palms: Start | None, further: Start | None
    ) -> Fitted:
        """Fit every hand of a batch.

        Args:
            observation: The landmarks.
            palms: Placements of the palm, batch × start, with poses; the table replaces the fingers' ones.
            further: Starts that are taken as they are, batch × start.
        """
        centred, plain = self._problems(observation)
        several = self._selected(centred, self._starts(centred, palms, further))
        best = self._advanced(centred, several, FINAL)
        best = best[least(best.model.value, len(observation), 1)]
        last = minimize(plain, Reached.at(plain, best.unknowns), LAST)
        found = self.objective(last.unknowns.parameters(plain.inverse), observation)
        found, _ = self._apart(plain, last.unknowns, found)
        if not (is_likelihood(self.objective.data_term) and centred.terms.bounds_pose):
            return found
        mixed = self._covariance(centred, last, several)
        # Of the hand as it is given out, which may have been moved: a file's reader has no other origin.
        covariance = self._corrected(mixed, found.prediction.parameters.translation)
        return replace(found, prediction=replace(found.prediction, covariance_3d=covariance))

    @torch.no_grad()
    def minima(
        self,
        observation: Observation,
        palms: Start | None,
        further: Start | None,
        rounds: Sequence[Round] = ROUNDS,
    ) -> Minima:
        """Fit every hand of a batch from several starts, and keep all results that differ.

        Args:
            observation: The landmarks.
            palms: Placements of the palm, as for the call.
            further: Starts, as for the call.
            rounds: Selection of the starts; `QUICK` if one of them is near the hand.

        Returns:
            Minima of each hand, the one of least loss first.
        """
        centred, plain = self._problems(observation)
        hands = len(observation)
        start = self._starts(centred, palms, further)
        several = self._selected(centred, start, rounds, different=True)
        count = len(several.damping) // max(hands, 1)
        rows = rows_of(hands, hands * count)
        of_each, plainly = centred[rows], plain[rows]
        several = minimize(of_each, several, Limits(FINAL.steps))
        several = several[least(several.model.value, hands, count, in_order=False)]
        # Most starts end in the same minimum, and one of these stands for all.
        distinct = (~is_repeated(of_each, several, hands)).flatten().nonzero()[:, 0]
        problem = plainly[distinct]
        last = minimize(problem, Reached.at(problem, several.unknowns[distinct]), LAST).unknowns
        found = self.objective(last.parameters(problem.inverse), problem.observation)
        _, last = self._apart(problem, last, found)
        several = several.put(distinct, Reached.at(of_each[distinct], last))
        again = is_repeated(of_each, several, hands)
        again.view(-1)[all_but(distinct, hands * count)] = True
        return Minima.of(of_each, several, again)

    @torch.no_grad()
    def covariance_at(
        self, observation: Observation, parameters: HandParameters
    ) -> Float[Tensor, "hand landmark=21 3 3"] | None:
        """Covariance of the landmarks of hands that need not be minima, such as smoothed ones.

        Args:
            observation: The landmarks of these hands.
            parameters: The hands.

        Returns:
            Square metres; None if the loss is no likelihood or leaves an angle free.
        """
        centred, _ = self._problems(observation)
        if not (is_likelihood(self.objective.data_term) and centred.terms.bounds_pose):
            return None
        unknowns = Unknowns.of_start(Start.of(parameters), observation.intrinsics)
        about = Minimum.of(centred, Reached.at(centred, unknowns))
        return self._corrected(about.covariance, parameters.translation)

    def _problems(self, observation: Observation) -> tuple[Problem, Problem]:
        """The loss with every angle drawn to the middle of its range, and the loss itself."""
        prior = self.objective.prior
        centred = Problem.of(
            self.free,
            PriorTerms(prior, centred=True),
            self.objective.data_term,
            observation,
            self.objective.seen_pose_term,
        )
        return centred, replace(centred, projection=self.projection, terms=PriorTerms(prior))

    def _covariance(
        self, problem: Problem, best: Reached, several: Reached
    ) -> Float[Tensor, "hand landmark=21 3 3"]:
        """Covariance of the landmarks of each hand about its result, without a correction.

        Args:
            problem: The loss with a prior that bounds every angle.
            best: The results.
            several: Results of several starts of each hand, behind each other.
        """
        hands = len(problem.target)
        count = len(several.damping) // max(hands, 1)
        result = Minimum.of(problem, Reached.at(problem, best.unknowns))
        others = Minimum.of(problem[rows_of(hands, len(several.damping))], several)
        return mixed_covariance(result, others, count)

    def _corrected(
        self, covariance: Float[Tensor, "hand landmark=21 3 3"], origin: Float[Tensor, "hand 3"]
    ) -> Float[Tensor, "hand landmark=21 3 3"]:
        """Covariances as they are given out, with origins in the camera's frame."""
        return covariance if self.correction is None else self.correction(covariance, origin)

    def _starts(self, problem: Problem, palms: Start | None, further: Start | None) -> Unknowns:
        """All starts, those of each hand behind each other."""
        hands = len(problem.target)
        found: list[Unknowns] = []
        if palms is not None and self.fingers is None:
            further = palms if further is None else Start.beside([palms, further])
        elif palms is not None and self.fingers is not None:
            several = problem[rows_of(hands, hands * palms.translation.shape[1])]
            seen = Seen.of(several.observation)
            placed = Unknowns.of_start(palms.flat(), seen.intrinsics)
            found += self.fingers.nearest(placed, seen)
        if further is not None:
            several = problem[rows_of(hands, hands * further.translation.shape[1])]
            found.append(Unknowns.of_start(further.flat(), several.observation.intrinsics))
        return Unknowns.beside(found, hands)

    def _selected(
        self,
        problem: Problem,
        start: Unknowns,
        rounds: Sequence[Round] = ROUNDS,
        *,
        different: bool = False,
    ) -> Reached:
        """The best starts of each hand after the rounds, or the best that differ, behind each other."""
        hands = len(problem.target)
        here = Reached.at(problem[rows_of(hands, len(start))], start)
        for of_round in rounds:
            if different:
                here = here[unlike(problem, here, of_round.starts)]
            here = self._advanced(problem, here, of_round)
            if of_round.look_up and self.fingers is not None:
                here = self._looked_up(problem, here, self.fingers)
        return here

    @staticmethod
    def _advanced(problem: Problem, here: Reached, of_round: Round) -> Reached:
        """The best starts of each hand after the steps of a round."""
        hands = len(problem.target)
        here = here[least(here.model.value, hands, of_round.starts)]
        return minimize(problem[rows_of(hands, len(here.damping))], here, Limits(of_round.steps))

    @staticmethod
    def _looked_up(problem: Problem, here: Reached, fingers: FingerPoses) -> Reached:
        """Two more starts per hand: its best one with fingers that are looked up for its palm."""
        hands = len(problem.target)
        best = here.unknowns[least(here.model.value, hands, 1)]
        more = Unknowns.beside(fingers.nearest(best, Seen.of(problem.observation)), hands)
        found = Reached.at(problem[rows_of(hands, len(more))], more)
        both = here.joined(found)
        order = torch.cat([rows_of(hands, len(here.damping)), rows_of(hands, len(more))])
        return both[order.argsort(stable=True)]

    def _apart(
        self, problem: Problem, unknowns: Unknowns, found: Fitted
    ) -> tuple[Fitted, Unknowns]:
        """Move parts of hands out of each other, if the prior has a term for that."""
        terms = self.objective.prior.terms
        names = [name for name, term in terms.items() if isinstance(term, NonPenetrationTerm)]
        if not names or names[0] not in found.loss:
            return found, unknowns
        hit = (found.loss[names[0]] > 0).nonzero()[:, 0]
        if not len(hit):
            return found, unknowns
        term = PenetrationTerm(self.objective.hand, cast("NonPenetrationTerm", terms[names[0]]))
        whole = WholeProblem(problem[hit], term)
        freed = minimize(whole, Reached.at(whole, unknowns[hit]), APART).unknowns
        some = problem[hit]
        fitted = self.objective(freed.parameters(some.inverse), some.observation)
        return found.put(hit, fitted), unknowns.put(hit, freed)
