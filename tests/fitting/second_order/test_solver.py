"""Second-order fits of known hands: as low as Adam's, whole or in parts, with labels missing."""

import copy
import logging
from dataclasses import replace

import pytest
import torch

from hand_recon.fitting.descent import Descent, fit, with_possible_solver
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.fitting.second_order.least_squares import Model, Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Limits, Reached, minimize
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.schema import HandBatch
from hand_recon.uncertainty import (
    DataTerm,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    SquaredError,
    Staged,
)
from hand_recon.uncertainty.covariance_correction import LAPLACE, correction_named
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.own_term import OwnTerm
from tests.support.views import known_hands, views

COUNT = 12
FAST = Descent(solver="second_order")


@pytest.fixture
def seen(hand: HandModel) -> HandBatch:
    return views(hand, known_hands(hand, COUNT))


@pytest.fixture
def prior(hand: HandModel) -> Prior:
    return Prior(
        {
            "range_of_motion": RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy()),
            "shape": ShapeTerm(hand),
        }
    )


@pytest.mark.parametrize("likelihood", [NegativeLogLikelihood(), LaplaceLikelihood()])
def test_the_loss_is_as_low_as_adams(
    hand: HandModel, prior: Prior, seen: HandBatch, likelihood: DataTerm
) -> None:
    term = Staged(SquaredError(), likelihood, switch_at=0.5)
    noisy = replace(seen, landmarks_2d=seen.landmarks_2d + 2 * torch.randn(COUNT, 21, 2))
    fast, slow = (
        fit(observed(noisy), Objective(hand, prior, term), descent=Descent(solver=solver)).loss
        for solver in ("second_order", "adam")
    )
    assert float(fast["total"].mean()) <= float(slow["total"].mean())
    assert (fast["total"] <= 1.005 * slow["total"]).float().mean() > 0.7


def test_parts_leave_each_other(hand: HandModel, seen: HandBatch) -> None:
    """With the full prior, little penetration is left of fists, and the loss falls."""
    whole = Prior.default(hand)
    term = NegativeLogLikelihood()
    fists = known_hands(hand, COUNT)
    bend = fists.joint_angles.clone()
    bend[..., 0] = 1.5
    seen = views(hand, replace(fists, joint_angles=bend))
    found = fit(observed(seen), Objective(hand, whole, term), descent=FAST)
    without = Prior(
        {
            "range_of_motion": RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy()),
            "shape": ShapeTerm(hand),
        }
    )
    before = fit(observed(seen), Objective(hand, without, term), descent=FAST)
    depth = whole.terms["non_penetration"](before.prediction.parameters, before.prediction.vertices)
    assert float(depth.sum()) > 0
    assert float(found.loss["non_penetration"].sum()) < 0.5 * float(depth.sum())
    assert (found.loss["total"] <= before.loss["total"] + 20_000 * depth + 1e-3).all()


def test_error_bars_of_parts_that_were_moved_have_the_origin_that_is_given_out(
    hand: HandModel,
) -> None:
    """Σ₀ comes back from the hands as they are written, also of those that were moved apart."""
    fists = known_hands(hand, COUNT)
    bend = fists.joint_angles.clone()
    bend[..., 0] = 1.5
    seen = observed(views(hand, replace(fists, joint_angles=bend)))
    objective = Objective(hand, Prior.default(hand), NegativeLogLikelihood())
    living, plain = (
        fit(seen, objective, descent=Descent(error_bars=name)).prediction
        for name in ("living", LAPLACE)
    )
    correction = correction_named("living")
    assert correction is not None
    assert living.covariance_3d is not None
    assert plain.covariance_3d is not None
    translation = living.parameters.translation.double()
    back = correction.laplace_of(living.covariance_3d.double(), translation)
    # Of rounding to single precision alone, in square metres.
    torch.testing.assert_close(back, plain.covariance_3d.double(), rtol=1e-4, atol=1e-10)


def test_missing_landmarks_are_not_looked_at(
    hand: HandModel, prior: Prior, seen: HandBatch
) -> None:
    labelled = torch.rand(COUNT, 21) > 0.3
    results = []
    for value in (torch.nan, 1e5):
        points = seen.landmarks_2d.masked_fill(~labelled[..., None], value)
        hidden = replace(seen, labelled=labelled, landmarks_2d=points)
        objective = Objective(hand, prior, NegativeLogLikelihood())
        results.append(fit(observed(hidden), objective, descent=FAST).prediction)
    assert torch.equal(results[0].landmarks_3d, results[1].landmarks_3d)
    assert results[0].vertices.isfinite().all()
    off = (results[0].landmarks_2d - seen.landmarks_2d).norm(dim=-1)
    assert float(off[labelled].mean()) < 2.0


def test_the_batch_does_not_matter(hand: HandModel, prior: Prior, seen: HandBatch) -> None:
    double = copy.deepcopy(hand).double()
    known = observed(seen)
    given = Observation(known.landmarks_2d.double(), known.labelled, known.intrinsics.double())
    objective = Objective(double, copy.deepcopy(prior).double(), NegativeLogLikelihood())
    whole, parts = (
        fit(given, objective, descent=Descent(solver="second_order", hands_at_once=size))
        for size in (256, 20)
    )
    torch.testing.assert_close(parts.loss["total"], whole.loss["total"], rtol=1e-6, atol=1e-6)


def test_no_hand_is_fitted_to_none(hand: HandModel, seen: HandBatch) -> None:
    none = observed(seen.select(slice(0)))
    found = fit(none, Objective(hand, Prior.default(hand), SquaredError()), descent=FAST)
    assert found.prediction.vertices.shape == (0, len(hand.template), 3)


def test_a_further_start_alone_is_kept(hand: HandModel, prior: Prior) -> None:
    """From the ground truth, the ground truth's landmarks are met."""
    known = known_hands(hand, COUNT)
    seen = views(hand, known)

    def told(_: Observation) -> Start:
        values = (known.joint_angles, known.root_rotation, known.translation, known.shape)
        return Start(*(value[:, None] for value in values))

    descent = Descent(solver="second_order", starts=0)
    objective = Objective(hand, prior, SquaredError())
    found = fit(observed(seen), objective, descent=descent, further=told)
    off = (found.prediction.landmarks_2d - seen.landmarks_2d).norm(dim=-1)
    assert float(off.mean(dim=1).max()) < 1.0


def test_a_step_that_raises_the_loss_is_taken_back() -> None:
    hand = double_hand()
    landmarks = 112 + 60 * torch.randn(COUNT, 21, 2, dtype=torch.float64)
    seen = Observation(landmarks, torch.ones(COUNT, 21, dtype=torch.bool), random_cameras(COUNT))
    terms = PriorTerms(Prior({"shape": ShapeTerm(hand)}))
    problem = Problem.of(LandmarkProjection(hand), terms, SquaredError(), seen)
    here = Reached.at(problem, random_unknowns(COUNT))
    values = [here.model.value]
    for _ in range(6):
        here = minimize(problem, here, Limits(1))
        values.append(here.model.value)
        assert (values[-1] <= values[-2]).all()
    assert (values[-1] < values[0]).all()

    class Broken:
        """A loss that is NaN away from where it starts."""

        def __call__(self, unknowns: Unknowns) -> Model:
            return replace(problem(unknowns), value=torch.full_like(values[0], torch.nan))

        def __getitem__(self, hands: torch.Tensor) -> "Broken":
            return self

    stuck = minimize(Broken(), here, Limits(2))
    assert torch.equal(stuck.unknowns.joint_angles, here.unknowns.joint_angles)
    assert (stuck.damping > here.damping).all()


def test_a_term_of_ones_own_is_left_to_adam(
    hand: HandModel, seen: HandBatch, caplog: pytest.LogCaptureFixture
) -> None:
    own = Objective(hand, Prior({"mine": OwnTerm(hand, weight=10.0)}), SquaredError())
    with caplog.at_level(logging.INFO):
        found = with_possible_solver(FAST, own)
    assert found == replace(FAST, solver="adam")
    assert "no derivatives of the prior's mine" in caplog.text
    known = Objective(hand, Prior({"shape": ShapeTerm(hand)}), SquaredError())
    assert with_possible_solver(FAST, known) == FAST


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(ValueError, match=r"descent\.solver=newton; expected one of second_order"):
        Descent(solver="newton")
