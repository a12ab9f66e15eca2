"""The loss of the second-order fit: values and gradients of the training's terms, hinges by hand."""

from dataclasses import replace

import pytest
import torch

from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.data_weights import data_weights, is_quadratic
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.penetration import PenetrationTerm
from hand_recon.fitting.second_order.prior_terms import (
    PriorTerms,
    RangeHinge,
    without_second_derivatives,
)
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, SHAPE
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.natural_pose import NaturalPoseTerm
from hand_recon.knowledge.pose_components import PoseComponentsTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import (
    NonPenetrationTerm,
    RangeOfMotionTerm,
    ShapeTerm,
    Term,
)
from hand_recon.uncertainty import (
    DataTerm,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
)
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.own_term import OwnTerm
from tests.support.tolerance import assert_close

HANDS = 4


def observation() -> Observation:
    """Random landmarks with σ; every fifth is missing."""
    labelled = torch.ones(HANDS, 21, dtype=torch.bool)
    labelled[:, ::5] = False
    landmarks = 112 + 40 * torch.randn(HANDS, 21, 2, dtype=torch.float64)
    sigma = 1 + 4 * torch.rand(HANDS, 21, dtype=torch.float64)
    landmarks[~labelled] = torch.nan
    return Observation(landmarks, labelled, random_cameras(HANDS), sigma)


def priors(hand: HandModel) -> dict[str, Prior]:
    ranges = RangeOfMotionTerm(hand)
    return {
        "none": Prior({"shape": ShapeTerm(hand)}),
        "biomechanics": Prior({"ranges": ranges, "shape": ShapeTerm(hand)}),
        "functional_anatomy": Prior(
            {
                "ranges": RangeOfMotionTerm(hand, anatomy=FunctionalAnatomy()),
                "shape": ShapeTerm(hand),
            }
        ),
        "ranges_only": Prior(
            {"ranges": RangeOfMotionTerm(hand, twist=False), "shape": ShapeTerm(hand)}
        ),
        "pca_mean": Prior(
            {"pose": PoseComponentsTerm(hand, weight=10.0), "shape": ShapeTerm(hand)}
        ),
    }


NAMES = ["none", "biomechanics", "functional_anatomy", "ranges_only", "pca_mean"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "term",
    [SquaredError(), NegativeLogLikelihood(), NegativeLogLikelihood(0.5), LaplaceLikelihood()],
    ids=["mse", "nll", "beta_nll", "laplace"],
)
def test_value_and_gradient_are_those_of_the_training_loss(name: str, term: DataTerm) -> None:
    hand, seen, unknowns = double_hand(), observation(), random_unknowns(HANDS)
    prior = priors(hand)[name].double()
    problem = Problem.of(LandmarkProjection(hand), PriorTerms(prior), term, seen)
    model = problem(unknowns)
    step = torch.zeros(HANDS, COUNT, dtype=torch.float64, requires_grad=True)
    objective = Objective(hand, prior, term, with_non_penetration=False)
    loss = objective(unknowns.moved(step).parameters(problem.inverse), seen).loss["total"]
    (expected,) = torch.autograd.grad(loss.sum(), step)
    gradient = model.gradient.clone()
    if model.hinge is not None:
        gradient[:, ANGLES] += model.hinge.expanded(model.hinge.angles)[0]
    # The norm of the shape is rounded off below 0.02 standard deviations.
    torch.testing.assert_close(gradient, expected, rtol=1e-4, atol=2e-3)
    # Values agree up to a constant: that of the likelihood, and the rounding of the norm.
    other = problem(random_unknowns(HANDS)).value  # Other hands, same landmarks.
    assert (other - model.value).abs().min() > 0
    moved = unknowns.moved(0.01 * torch.randn(HANDS, COUNT, dtype=torch.float64))
    changed = problem(moved).value - model.value
    after = objective(moved.parameters(problem.inverse), seen).loss["total"]
    torch.testing.assert_close(changed, (after - loss).detach(), rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("terms", [1, 2])
def test_the_curvature_of_a_linear_problem_is_its_second_derivative(terms: int) -> None:
    """With residuals of zero, Gauss-Newton is exact."""
    hand, unknowns = double_hand(), random_unknowns(HANDS)
    cameras = random_cameras(HANDS)
    projection, inverse = LandmarkProjection(hand), torch.linalg.inv(cameras)
    pixels = projection(unknowns, cameras, inverse).pixels.permute(2, 1, 0).contiguous()
    seen = Observation(pixels, torch.ones(HANDS, 21, dtype=torch.bool), cameras)
    distances = {"pose": PoseComponentsTerm(hand, weight=10.0), "natural": NaturalPoseTerm(hand)}
    prior = Prior(dict(list(distances.items())[:terms])).double()
    model = Problem.of(projection, PriorTerms(prior), NegativeLogLikelihood(), seen)(unknowns)
    objective = Objective(hand, prior, NegativeLogLikelihood(), with_non_penetration=False)

    def loss(step: torch.Tensor) -> torch.Tensor:
        parameters = unknowns.moved(step[None].expand(HANDS, COUNT)).parameters(inverse)
        return objective(parameters, seen).loss["total"].sum()

    zero = torch.zeros(COUNT, dtype=torch.float64)
    expected = torch.autograd.functional.hessian(loss, zero)
    torch.testing.assert_close(model.curvature.sum(dim=0), expected, rtol=1e-4, atol=1e-1)


def test_the_hinge_has_the_branch_of_the_expected_angle() -> None:
    """Bounds ±1, λ = 3: at 1.5 the slope is 2·3·0.5; a step expected to end inside has none."""
    hinge = RangeHinge(
        torch.tensor([[1.5, 0.5, -1.2]]), torch.full((1, 3), -1.0), torch.full((1, 3), 1.0), 3.0
    )
    assert_close(hinge.value(), torch.tensor([3 * (0.25 + 0.04)]))
    slope, curvature = hinge.expanded(hinge.angles)
    assert_close(slope, torch.tensor([[3.0, 0.0, -1.2]]))
    assert_close(curvature, torch.tensor([[6.0, 0.0, 6.0]]))
    slope, curvature = hinge.expanded(torch.tensor([[0.0, 2.0, -1.2]]))
    # The second angle crosses its bound at 1: seen from 0.5 the parabola about 1 has a slope of −3.
    assert_close(slope, torch.tensor([[0.0, -3.0, -1.2]]))
    assert_close(curvature, torch.tensor([[0.0, 6.0, 6.0]]))


def test_unbounded_angles_cost_nothing() -> None:
    wide = torch.full((1, 2), torch.inf)
    hinge = RangeHinge(torch.tensor([[100.0, -3.0]]), -wide, wide, 20_000.0)
    slope, curvature = hinge.expanded(hinge.angles)
    assert_close(hinge.value(), torch.zeros(1))
    assert_close(slope, torch.zeros(1, 2))
    assert_close(curvature, torch.zeros(1, 2))


def test_centring_counts_in_deviations_of_a_uniform_distribution() -> None:
    """A range of width w has the variance w²/12; its bounds are √3 deviations from the middle."""
    hand = double_hand()
    term = RangeOfMotionTerm(hand, twist=False).double()
    prior = Prior({"ranges": term})
    unknowns = random_unknowns(1)
    middle = (term.lower + term.upper) / 2
    index_mcp_bend = (0, 0)
    angles = torch.where(middle.isfinite(), middle, 7.0).clone()
    centred = PriorTerms(prior, centred=True)
    start = replace(unknowns, joint_angles=angles[None])
    assert_close(centred.smooth(start).value, torch.zeros(1, dtype=torch.float64))
    angles[index_mcp_bend] = term.upper[index_mcp_bend]
    moved = centred.smooth(replace(unknowns, joint_angles=angles[None]))
    assert_close(moved.value, torch.tensor([1.5], dtype=torch.float64))
    plain = PriorTerms(prior).smooth(replace(unknowns, joint_angles=angles[None]))
    assert float(plain.value) == 0
    # Twist has no range here: nothing pulls it.
    assert not moved.diagonal[0, ANGLES].view(15, 3)[:, 2].any()


def test_angles_that_the_ranges_fix_are_not_free() -> None:
    hand = double_hand()
    term = RangeOfMotionTerm(hand)
    free = PriorTerms(Prior({"ranges": term})).free()
    assert len(free) == int((term.upper > term.lower).sum()) + 16
    assert len(PriorTerms(Prior({"shape": ShapeTerm(hand)})).free()) == COUNT


def test_terms_of_ones_own_have_no_second_derivatives() -> None:
    hand = double_hand()

    class Twice(RangeOfMotionTerm):
        """A term that a class of the package would be taken for."""

    ranges = RangeOfMotionTerm(hand)
    terms: dict[str, Term] = {"ranges": ranges, "shape": ShapeTerm(hand)}
    assert without_second_derivatives(Prior(terms)) == []
    terms |= {"own": OwnTerm(hand, weight=1.0), "again": Twice(hand)}
    assert without_second_derivatives(Prior(terms)) == ["own", "again"]
    assert without_second_derivatives(Prior({"a": ranges, "b": RangeOfMotionTerm(hand)})) == ["b"]


def test_squares_have_constant_weights_and_others_do_not() -> None:
    staged = Staged(SquaredError(), LaplaceLikelihood(), switch_at=0.5)
    assert is_quadratic(staged)
    staged.begin(step=9, epoch=0, total_steps=10)
    assert not is_quadratic(staged)
    assert is_quadratic(RescaledSquaredError(2.0))
    # 1 / σ² and, of 42 labels with two missing landmarks, 21 / 19 of it.
    labelled = torch.ones(1, 21, dtype=torch.bool)
    labelled[0, :2] = False
    log_sigma = torch.full((1, 21, 2), 4.0).log()
    residual = torch.randn(1, 21, 2)
    weights = data_weights(NegativeLogLikelihood(), residual, log_sigma, labelled)
    expected = torch.full((1, 21, 2), 21 / 19 / 16)
    expected[0, :2] = 0
    assert_close(weights, expected)
    # Laplace: √2 / σ / |e|.
    residual = torch.full((1, 21, 2), -2.0)
    weights = data_weights(LaplaceLikelihood(), residual, log_sigma, torch.ones_like(labelled))
    assert_close(weights, torch.full((1, 21, 2), 2**0.5 / 4 / 2))


def test_depths_have_autograds_value_and_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without margin and rounding, the parabola touches the term itself."""
    module = "hand_recon.fitting.second_order.penetration"
    monkeypatch.setattr(f"{module}.MARGIN", 0.0)
    monkeypatch.setattr(f"{module}.ROUNDING", 1e-12)
    hand = double_hand()
    term = NonPenetrationTerm(hand, weight=20_000.0).double()
    unknowns = random_unknowns(HANDS)
    unknowns = replace(unknowns, joint_angles=1.5 * unknowns.joint_angles)
    value, gradient, curvature = PenetrationTerm(hand, term)(unknowns)
    angles = unknowns.joint_angles.clone().requires_grad_()
    shape = unknowns.shape.clone().requires_grad_()
    expected = 20_000 * term.non_penetration(hand(angles, shape).vertices)
    assert (expected.detach() > 0).any()
    assert_close(value, expected.detach())
    by_angle, by_shape = torch.autograd.grad(expected.sum(), (angles, shape))
    torch.testing.assert_close(gradient[:, ANGLES], by_angle.flatten(1), rtol=1e-5, atol=1e-3)
    torch.testing.assert_close(gradient[:, SHAPE], by_shape, rtol=1e-5, atol=1e-3)
    # It does not depend on where the hand is, and the parabola opens upwards.
    assert not gradient[:, ANGLES.stop : SHAPE.start].any()
    assert float(torch.linalg.eigvalsh(curvature).min()) > -1e-4
