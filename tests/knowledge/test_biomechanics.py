"""Eq. 1: joints stay inside their ranges."""

import math

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.biomechanics import pose_loss
from hand_recon.knowledge.prior import Prior, shape_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.schema import HandParameters, HandPrediction
from tests.knowledge import reference
from tests.tolerance import BATCH_SHAPES, assert_close


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    """Bounds of −20° to 60° for every axis."""
    return RangeOfMotion(
        torch.full((15, 3), math.radians(-20), dtype=torch.float64),
        torch.full((15, 3), math.radians(60), dtype=torch.float64),
    )


def prediction(joint_angles: torch.Tensor, shape: torch.Tensor) -> HandPrediction:
    """A prediction of which the prior only needs the parameters."""
    count = len(joint_angles)
    parameters = HandParameters(
        joint_angles, shape, torch.eye(3).expand(count, 3, 3), torch.zeros(count, 3)
    )
    points = torch.zeros(count, 21, 3)
    return HandPrediction(
        parameters, points, points[:, :16], points, points[..., :2], points[..., :2],
        torch.eye(3).expand(count, 3, 3),
    )  # fmt: skip


def test_ten_degrees_past_one_limit_costs_ten_degrees_squared(ranges: RangeOfMotion) -> None:
    angles = torch.zeros(15, 3, dtype=torch.float64)
    angles[4, 0] = math.radians(70)
    assert_close(pose_loss(angles, ranges), torch.tensor(math.radians(10) ** 2))
    angles[9, 1] = math.radians(-40)
    expected = math.radians(10) ** 2 + math.radians(20) ** 2
    assert_close(pose_loss(angles, ranges), torch.tensor(expected))


def test_ten_degrees_cost_609_with_the_weight_of_the_paper() -> None:
    """λ₁ = 20000 against a data term in pixels: the balance the weights were chosen for."""
    assert 20_000 * math.radians(10) ** 2 == pytest.approx(609.2, abs=0.05)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_the_paper_written_out_joint_by_joint(
    ranges: RangeOfMotion, shape: tuple[int, ...]
) -> None:
    angles = torch.randn(*shape, 15, 3, dtype=torch.float64)
    expected = reference.pose_loss(angles.numpy(), ranges.lower.numpy(), ranges.upper.numpy())
    assert_close(pose_loss(angles, ranges), torch.as_tensor(expected))


def test_is_flat_inside_the_ranges(ranges: RangeOfMotion) -> None:
    inside = torch.rand(8, 15, 3, dtype=torch.float64)
    angles = (ranges.lower + inside * (ranges.upper - ranges.lower)).requires_grad_()
    loss = pose_loss(angles, ranges)
    loss.sum().backward()
    assert (loss == 0).all()
    assert angles.grad is not None
    assert angles.grad.count_nonzero() == 0


def test_gradient_matches_finite_differences(ranges: RangeOfMotion) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda angles: pose_loss(angles, ranges), angles)


def test_gradient_is_finite_on_the_bounds_and_far_outside(ranges: RangeOfMotion) -> None:
    for angles in (ranges.lower, ranges.upper, ranges.upper + 1e4):
        leaf = angles.clone().requires_grad_()
        pose_loss(leaf, ranges).backward()
        assert leaf.grad is not None
        assert torch.isfinite(leaf.grad).all()


def test_shape_loss_is_the_norm_with_a_finite_gradient_at_the_mean() -> None:
    shape = torch.zeros(2, 10, dtype=torch.float64)
    shape[1, :2] = torch.tensor([3.0, 4.0])
    shape.requires_grad_()
    loss = shape_loss(shape)
    loss.sum().backward()
    assert shape.grad is not None
    assert loss[0].item() < 1e-5
    assert loss[1].item() == pytest.approx(5.0)
    assert torch.isfinite(shape.grad).all()
    assert_close(shape.grad[1, :2], torch.tensor([0.6, 0.8]))


def test_the_prior_adds_its_terms_with_the_weights_of_the_paper(hand: HandModel) -> None:
    prior = Prior(load_ranges("literature", hand.rest_angles))
    angles = torch.zeros(2, 15, 3)
    angles[1, 0, 2] = math.radians(10)  # No finger twists.
    shape = torch.zeros(2, 10)
    shape[:, 0] = 2.0
    terms = prior(prediction(angles, shape))
    assert set(terms) == {"range_of_motion", "shape"}
    weighted = prior.weighted(terms)
    excess = weighted["range_of_motion"][1] - weighted["range_of_motion"][0]
    assert float(excess) == pytest.approx(609.2, abs=0.1)
    assert_close(weighted["shape"], torch.tensor([20.0, 20.0]))


def test_a_weight_of_zero_switches_a_term_off(hand: HandModel) -> None:
    prior = Prior(load_ranges("literature", hand.rest_angles), range_of_motion=0.0)
    assert set(prior(prediction(torch.randn(3, 15, 3), torch.randn(3, 10)))) == {"shape"}


def test_knowledge_that_is_not_there_yet_is_refused_plainly(hand: HandModel) -> None:
    ranges = load_ranges("literature", hand.rest_angles)
    with pytest.raises(NotImplementedError, match=r"functional anatomy.*prior=biomechanics"):
        Prior(ranges, functional_anatomy=True)
    with pytest.raises(NotImplementedError, match=r"non-penetration.*prior=biomechanics"):
        Prior(ranges, non_penetration=20_000.0)
