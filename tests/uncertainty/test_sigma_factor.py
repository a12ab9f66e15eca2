"""Factor of a network's σ: by hand, on drawn residuals, beside the σ of labels, and its limits."""

import math

import pytest
import torch

from hand_recon.uncertainty.sigma_factor import BOUNDS, LEVEL, sigma_factor


def test_the_factor_agrees_with_a_calculation_by_hand() -> None:
    """Residuals of 1 to 9 σ: the 8th is at the 80 % interval's bound, 1.2816 f σ, so f is 8 / 1.2816."""
    sigma = torch.full((9,), 0.5, dtype=torch.float64)
    residual = sigma * torch.tensor([3.0, -1, 4, 9, -5, 6, 2, -8, 7])
    assert sigma_factor(residual, sigma) == pytest.approx(8 / 1.2815516, rel=1e-6)


@pytest.mark.parametrize("factor", [0.3, 1.0, 2.5])
def test_residuals_of_another_scale_give_that_scale(factor: float) -> None:
    sigma = torch.exp(torch.rand(20_000, dtype=torch.float64) * math.log(20))
    residual = factor * sigma * torch.randn(20_000, dtype=torch.float64)
    # Four standard errors of the 80 % quantile of |e|: √(0.16 / 20,000) / 0.351 / 1.28.
    assert sigma_factor(residual, sigma) == pytest.approx(factor, rel=0.026)


def test_new_residuals_of_a_heavy_tail_are_inside_as_often_as_said() -> None:
    sigma = torch.full((8000,), 2.0, dtype=torch.float64)
    drawn = torch.distributions.StudentT(torch.tensor(2.0, dtype=torch.float64))
    fitted, fresh = (2 * drawn.sample((8000,)) for _ in range(2))
    inside = fresh.abs() <= 1.2815516 * sigma_factor(fitted, sigma) * sigma
    # Two samples of 8,000: four standard errors.
    assert float(inside.double().mean()) == pytest.approx(LEVEL, abs=0.026)


def test_the_noise_of_labels_is_not_scaled() -> None:
    """Residuals of √((2σ)² + n²): the factor of the network's own σ is 2."""
    sigma = torch.full((40_000,), 1.0, dtype=torch.float64)
    noise = torch.full_like(sigma, 2.0)
    residual = torch.hypot(2 * sigma, noise) * torch.randn(40_000, dtype=torch.float64)
    assert sigma_factor(residual, sigma, noise) == pytest.approx(2.0, rel=0.06)
    assert sigma_factor(residual, sigma) == pytest.approx(math.sqrt(8), rel=0.03)


def test_the_factor_stays_within_its_bounds() -> None:
    sigma = torch.ones(10, dtype=torch.float64)
    assert sigma_factor(torch.zeros_like(sigma), sigma) == pytest.approx(BOUNDS[0])
    assert sigma_factor(1e6 * sigma, sigma) == pytest.approx(BOUNDS[1])
    assert sigma_factor(torch.empty(0), torch.empty(0)) == 1.0
