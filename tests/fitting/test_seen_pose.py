"""The pose that a network sees, as a term of a fit to landmarks."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT
from hand_recon.fitting.seen_pose import SeenPoseTerm, believed
from hand_recon.fitting.shared_shape import ShapeModel
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.natural_pose import NaturalPoseTerm, natural_poses
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.schema import HandEstimate, HandParameters
from hand_recon.uncertainty import NegativeLogLikelihood
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

HANDS = 4


def of_poses(observation: Observation, poses: Tensor) -> Observation:
    """The same observation with poses that a network saw."""
    hands = len(observation)
    nothing = HandParameters(
        torch.zeros(hands, 15, 3),
        torch.zeros(hands, 10),
        torch.eye(3).repeat(hands, 1, 1),
        torch.zeros(hands, 3),
    )
    estimate = HandEstimate(nothing, torch.zeros(hands, 21, 2), poses)
    return replace(observation, estimate=estimate)


def observation(poses: Tensor) -> Observation:
    landmarks = 112 + 40 * torch.randn(HANDS, 21, 2, dtype=torch.float64)
    labelled = torch.ones(HANDS, 21, dtype=torch.bool)
    return of_poses(Observation(landmarks, labelled, random_cameras(HANDS)), poses)


def test_the_distance_is_mahalanobis_with_the_covariance_of_natural_poses() -> None:
    covariance = natural_poses()[1].double()
    poses, angles = torch.randn(2, HANDS, 15, 3, dtype=torch.float64)
    difference = (angles - poses).flatten(1)
    expected = 0.7 * (difference @ torch.linalg.inv(covariance) * difference).sum(dim=1)
    term, seen = SeenPoseTerm.of(0.7), observation(poses)
    assert_close(
        0.7 * term.value(angles.flatten(1), seen), term.expanded(angles.flatten(1), seen).value
    )
    value = 0.7 * term.value(angles.flatten(1), seen)
    torch.testing.assert_close(value, expected, rtol=1e-3, atol=0)


def test_hands_that_no_network_saw_have_no_loss() -> None:
    poses = torch.randn(HANDS, 15, 3)
    poses[1] = torch.nan
    angles = torch.randn(HANDS, 45)
    term = SeenPoseTerm.of(1.0)
    model = term.expanded(angles, observation(poses))
    assert model.value[1] == 0
    assert not model.gradient[1].any()
    assert not model.curvature[1].any()
    assert (model.value[[0, 2, 3]] > 1).all()
    nobody = observation(torch.full((HANDS, 15, 3), torch.nan))
    for seen in (nobody, replace(nobody, estimate=None)):
        assert torch.equal(term.value(angles, seen), torch.zeros(HANDS))
        assert not term.expanded(angles, seen).curvature.any()


def test_a_pose_is_believed_where_the_network_found_the_landmarks() -> None:
    poses = torch.randn(3, 15, 3)
    given = 60 * torch.rand(3, 21, 2)
    # 3-4-5: every landmark of the second hand is 12.5 pixels of a crop of 112 off, 25 of one of 224.
    found = given + torch.tensor([[0.0, 0.0], [7.5, 10.0], [5.4, 7.2]])[:, None]
    given[2, :5] = torch.nan
    trusted = believed(poses, found, given, 112)
    assert torch.equal(trusted[[0, 2]], poses[[0, 2]])
    assert trusted[1].isnan().all()


@pytest.mark.parametrize("weight", [-1.0, float("inf"), float("nan")])
def test_weights_that_are_no_weights_are_refused(weight: float) -> None:
    with pytest.raises(ValueError, match=f"Found seen_pose_weight={weight}; expected a number"):
        SeenPoseTerm.of(weight)


@pytest.mark.parametrize("fixed", [False, True], ids=["every unknown", "without fixed angles"])
def test_value_gradient_and_curvature_of_the_solver_are_those_of_the_loss(*, fixed: bool) -> None:
    hand, unknowns = double_hand(), random_unknowns(HANDS)
    poses = torch.randn(HANDS, 15, 3, dtype=torch.float64)
    poses[2] = torch.nan
    seen, term = observation(poses), SeenPoseTerm.of(3.0)
    prior = Prior({"shape": ShapeTerm(hand), "ranges": RangeOfMotionTerm(hand)}).double()
    terms = PriorTerms(prior)
    free = terms.free() if fixed else None
    projection = LandmarkProjection(hand) if free is None else LandmarkProjection(hand, free)
    data = NegativeLogLikelihood()
    model = Problem.of(projection, terms, data, seen, term)(unknowns)
    without = Problem.of(projection, terms, data, seen)(unknowns)
    inverse = torch.linalg.inv(seen.intrinsics)

    def loss(step: Tensor) -> Tensor:
        objective = Objective(hand, prior, data, with_non_penetration=False, seen_pose_term=term)
        parameters = unknowns.moved(step).parameters(inverse)
        found = objective(parameters, seen).loss
        assert_close(found["seen_pose"] * 3.0, found["weighted/seen_pose"])
        return found["weighted/seen_pose"]

    step = torch.zeros(HANDS, COUNT, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(loss(step).sum(), step)
    curvature = torch.zeros(HANDS, COUNT, COUNT, dtype=torch.float64)
    for place in range(HANDS):
        curvature[place] = torch.autograd.functional.hessian(
            lambda one, place=place: loss(
                torch.where(torch.arange(HANDS)[:, None] == place, one, 0)
            )[place],
            torch.zeros(COUNT, dtype=torch.float64),
        )
    rows = torch.arange(COUNT) if free is None else free
    assert_close(model.value - without.value, loss(torch.zeros(HANDS, COUNT, dtype=torch.float64)))
    torch.testing.assert_close(
        model.gradient - without.gradient, gradient[:, rows], rtol=1e-6, atol=1e-6
    )
    torch.testing.assert_close(
        model.curvature - without.curvature, curvature[:, rows][:, :, rows], rtol=1e-6, atol=1e-6
    )
    assert curvature[:, ANGLES].any()


def test_a_seen_pose_mends_what_noisy_landmarks_leave_open(hand: HandModel) -> None:
    """Landmarks with noise of 4 px alone, and with the true pose to within 0.1 rad."""
    torch.manual_seed(3)
    known = known_hands(hand, 12)
    batch = views(hand, known)
    assert batch.landmarks_3d is not None
    assert batch.intrinsics is not None
    landmarks = batch.landmarks_2d + 4 * torch.randn_like(batch.landmarks_2d)
    seen = Observation(landmarks, batch.labelled, batch.intrinsics)
    poses = known.joint_angles + 0.1 * torch.randn_like(known.joint_angles)
    ranges, shape = RangeOfMotionTerm(hand), ShapeTerm(hand)
    prior = Prior({"ranges": ranges, "shape": shape, "natural": NaturalPoseTerm(hand)})
    objective = Objective(hand, prior, NegativeLogLikelihood(), with_non_penetration=False)

    def error(objective: Objective, seen: Observation) -> float:
        found = fit(
            seen,
            objective,
            descent=Descent(steps=30),
            further=lambda one: Start.one_each(known_hands(hand, len(one))),
        ).prediction
        points = found.landmarks_3d - found.landmarks_3d[:, :1]
        assert batch.landmarks_3d is not None
        truth = batch.landmarks_3d - batch.landmarks_3d[:, :1]
        return float((points - truth).norm(dim=-1).mean())

    alone = error(objective, seen)
    with_pose = error(
        replace(objective, seen_pose_term=SeenPoseTerm.of(1.0)), of_poses(seen, poses)
    )
    assert with_pose < 0.8 * alone
    assert error(replace(objective, seen_pose_term=SeenPoseTerm.of(1.0)), seen) == pytest.approx(
        alone
    )


def test_a_known_pose_leaves_more_of_the_landmarks_to_the_shape() -> None:
    hand, unknowns = double_hand(), random_unknowns(HANDS)
    seen = observation(unknowns.joint_angles)
    prior = Prior({"shape": ShapeTerm(hand), "natural": NaturalPoseTerm(hand)}).double()
    terms, projection = PriorTerms(prior), LandmarkProjection(hand)
    data = NegativeLogLikelihood()
    alone = ShapeModel.of(Problem.of(projection, terms, data, seen), unknowns)
    tiny = ShapeModel.of(Problem.of(projection, terms, data, seen, SeenPoseTerm.of(1e-9)), unknowns)
    fixed = ShapeModel.of(Problem.of(projection, terms, data, seen, SeenPoseTerm.of(1e3)), unknowns)
    assert_close(tiny.curvature, alone.curvature)
    assert (torch.linalg.eigvalsh(fixed.curvature) > torch.linalg.eigvalsh(alone.curvature)).all()
