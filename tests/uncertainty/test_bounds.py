"""The bounds of log σ."""

import math

import pytest
import torch

from hand_recon.uncertainty import soft_bound
from tests.support.tolerance import BATCH_SHAPES, assert_close

LOWER, UPPER = math.log(0.5), math.log(50.0)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_sigma_from_one_to_thirty_pixels_is_left_alone(shape: tuple[int, ...]) -> None:
    raw = torch.rand(*shape, 21, 2) * math.log(30)
    assert torch.equal(soft_bound(raw), raw)


def test_no_number_leaves_the_bounds() -> None:
    raw = torch.tensor([-1e30, -100.0, -30.0, -1.0, 4.0, 30.0, 100.0, 1e30])
    bounded = soft_bound(raw)
    assert (bounded >= LOWER - 1e-6).all()
    assert (bounded <= UPPER + 1e-6).all()
    assert_close(bounded[[0, -1]], torch.tensor([LOWER, UPPER]))


def test_a_hand_computed_value_beyond_the_bend() -> None:
    """Bounds 0 and 10 bend at 1 and 9: ten beyond, 9 + 1 · 10 / 11."""
    raw = torch.tensor([19.0, -9.0])
    assert_close(soft_bound(raw, 0.0, 10.0), torch.tensor([9 + 10 / 11, 1 - 10 / 11]))


def test_it_rises_everywhere_and_its_slope_has_no_jump() -> None:
    raw = torch.linspace(-30, 30, 60_001, dtype=torch.float64, requires_grad=True)
    bounded = soft_bound(raw)
    (slope,) = torch.autograd.grad(bounded.sum(), raw)
    assert (bounded.diff() > 0).all()
    assert float(slope.max()) <= 1.0
    # The second derivative is at most 2 / margin = 4.3; a jump of the first by one would give 1000.
    assert float(slope.diff().abs().max()) / 1e-3 < 4.4


def test_no_sigma_is_dead_at_thirty_beyond() -> None:
    raw = torch.tensor([-30.0, 30.0], requires_grad=True)
    (slope,) = torch.autograd.grad(soft_bound(raw).sum(), raw)
    assert (slope > 1e-4).all()


def test_where_it_bends_the_slope_is_one_from_either_side() -> None:
    raw = torch.tensor([1.0, 9.0], requires_grad=True)
    (slope,) = torch.autograd.grad(soft_bound(raw, 0.0, 10.0).sum(), raw)
    assert_close(slope, torch.ones(2))


def test_gradient_matches_finite_differences() -> None:
    raw = torch.tensor([-8.0, -0.5, 0.0, 2.0, 3.7, 9.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(soft_bound, raw)
