"""Eq. 1: joints stay inside their ranges."""

import math

import pytest
import torch

from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion
from tests.support import knowledge_reference as reference
from tests.support.tolerance import BATCH_SHAPES, assert_close


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    """Bounds of −20° to 60° for every axis."""
    return RangeOfMotion(
        torch.full((15, 3), math.radians(-20), dtype=torch.float64),
        torch.full((15, 3), math.radians(60), dtype=torch.float64),
    )


def test_ten_degrees_past_one_limit_costs_ten_degrees_squared(ranges: RangeOfMotion) -> None:
    angles = torch.zeros(15, 3, dtype=torch.float64)
    angles[4, 0] = math.radians(70)
    assert_close(range_of_motion_loss(angles, ranges), torch.tensor(math.radians(10) ** 2))
    angles[9, 1] = math.radians(-40)
    expected = math.radians(10) ** 2 + math.radians(20) ** 2
    assert_close(range_of_motion_loss(angles, ranges), torch.tensor(expected))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_the_paper_written_out_joint_by_joint(
    ranges: RangeOfMotion, shape: tuple[int, ...]
) -> None:
    angles = torch.randn(*shape, 15, 3, dtype=torch.float64)
    expected = reference.range_of_motion_loss(
        angles.numpy(), ranges.lower.numpy(), ranges.upper.numpy()
    )
    assert_close(range_of_motion_loss(angles, ranges), torch.as_tensor(expected))


def test_is_flat_inside_the_ranges(ranges: RangeOfMotion) -> None:
    inside = torch.rand(8, 15, 3, dtype=torch.float64)
    angles = (ranges.lower + inside * (ranges.upper - ranges.lower)).requires_grad_()
    loss = range_of_motion_loss(angles, ranges)
    loss.sum().backward()
    assert (loss == 0).all()
    assert angles.grad is not None
    assert angles.grad.count_nonzero() == 0


def test_gradient_matches_finite_differences(ranges: RangeOfMotion) -> None:
    angles = torch.randn(2, 15, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda angles: range_of_motion_loss(angles, ranges), angles)


def test_gradient_is_finite_on_the_bounds_and_far_outside(ranges: RangeOfMotion) -> None:
    for angles in (ranges.lower, ranges.upper, ranges.upper + 1e4):
        leaf = angles.clone().requires_grad_()
        range_of_motion_loss(leaf, ranges).backward()
        assert leaf.grad is not None
        assert torch.isfinite(leaf.grad).all()
