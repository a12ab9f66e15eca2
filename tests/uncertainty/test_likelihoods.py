"""Eq. 7 and its variants against torch.distributions, and their minima."""

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor
from torch.distributions import Laplace, MultivariateNormal, Normal

from hand_recon.uncertainty.likelihoods import beta_gaussian, full_gaussian, gaussian, laplace
from tests.support.tolerance import BATCH_SHAPES, assert_close

GAUSSIAN_CONSTANT = 0.5 * math.log(2 * math.pi)
LAPLACE_CONSTANT = 0.5 * math.log(2)


def numbers(shape: tuple[int, ...]) -> tuple[Tensor, Tensor, Tensor]:
    """Residuals of some pixels, log σ around 1 and correlations, in double precision."""
    residual = 5 * torch.randn(*shape, 21, 2, dtype=torch.float64)
    log_sigma = 1 + torch.randn(*shape, 21, 2, dtype=torch.float64)
    return residual, log_sigma, torch.rand(*shape, 21, dtype=torch.float64) * 1.8 - 0.9


def test_a_residual_of_six_pixels_with_a_sigma_of_two() -> None:
    """By hand: log 2 + 36 / 8 = 5.193; log 2 + √2 · 6 / 2 = 4.936."""
    residual, log_sigma = torch.tensor(6.0), torch.tensor(2.0).log()
    assert float(gaussian(residual, log_sigma)) == pytest.approx(5.1931, abs=1e-4)
    assert float(laplace(residual, log_sigma)) == pytest.approx(4.9358, abs=1e-4)
    # σ² = 4, and β = ½ multiplies by its root.
    assert float(beta_gaussian(residual, log_sigma, 0.5)) == pytest.approx(2 * 5.1931, abs=1e-3)


def test_a_residual_along_the_correlation_is_likelier_than_one_across() -> None:
    """By hand, σ = 1 and ρ = 0.6: ½ log 0.64 + ½ · 2 / 1.6 = 0.402, and ½ · 2 / 0.4 = 2.277."""
    along, across = torch.tensor([1.0, 1.0]), torch.tensor([1.0, -1.0])
    zero, correlation = torch.zeros(2), torch.tensor(0.6)
    assert float(full_gaussian(along, zero, correlation)) == pytest.approx(0.4019, abs=1e-4)
    assert float(full_gaussian(across, zero, correlation)) == pytest.approx(2.2769, abs=1e-4)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_the_gaussian_is_the_normal_distribution_without_its_constant(
    shape: tuple[int, ...],
) -> None:
    residual, log_sigma, _ = numbers(shape)
    log_density = Normal(torch.zeros_like(residual), log_sigma.exp()).log_prob(residual)
    assert_close(gaussian(residual, log_sigma) + GAUSSIAN_CONSTANT, -log_density)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_the_laplace_has_sigma_as_its_standard_deviation(shape: tuple[int, ...]) -> None:
    residual, log_sigma, _ = numbers(shape)
    distribution = Laplace(torch.zeros_like(residual), log_sigma.exp() / math.sqrt(2))
    assert_close(distribution.stddev, log_sigma.exp())
    log_density = distribution.log_prob(residual)
    assert_close(laplace(residual, log_sigma) + LAPLACE_CONSTANT, -log_density)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_the_full_gaussian_is_the_multivariate_normal(shape: tuple[int, ...]) -> None:
    residual, log_sigma, correlation = numbers(shape)
    sigma = log_sigma.exp()
    covariance = torch.diag_embed(sigma.square())
    off_diagonal = correlation * sigma.prod(dim=-1)
    covariance[..., 0, 1] = covariance[..., 1, 0] = off_diagonal
    log_density = MultivariateNormal(torch.zeros_like(residual), covariance).log_prob(residual)
    value = full_gaussian(residual, log_sigma, correlation)
    assert_close(value + 2 * GAUSSIAN_CONSTANT, -log_density)


def test_without_correlation_the_full_gaussian_is_eq_7() -> None:
    residual, log_sigma, correlation = numbers((4,))
    full = full_gaussian(residual, log_sigma, torch.zeros_like(correlation))
    assert_close(full, gaussian(residual, log_sigma).sum(dim=-1))


def test_a_full_gaussian_turned_by_45_degrees_is_two_independent_ones() -> None:
    """Equal σ and ρ: variances σ² (1 ± ρ) along the diagonals, whatever the residual."""
    residual, log_sigma, correlation = numbers((4,))
    log_sigma = log_sigma[..., :1].expand_as(residual)
    turn = torch.tensor([[1.0, 1.0], [1.0, -1.0]], dtype=torch.float64) / math.sqrt(2)
    widths = log_sigma + 0.5 * torch.log1p(torch.stack([correlation, -correlation], dim=-1))
    expected = gaussian(residual @ turn, widths).sum(dim=-1)
    assert_close(full_gaussian(residual, log_sigma, correlation), expected)


def gradient(function: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
    leaf = at.clone().requires_grad_()
    (slope,) = torch.autograd.grad(function(leaf).sum(), leaf)
    return slope


def test_a_constant_sigma_makes_eq_7_the_squared_error_rescaled() -> None:
    residual, _, _ = numbers((4,))
    log_sigma = torch.full_like(residual, math.log(3.0))
    assert_close(gaussian(residual, log_sigma), math.log(3.0) + residual.square() / 18)
    pull = gradient(lambda leaf: gaussian(leaf, log_sigma), residual)
    assert_close(pull, gradient(torch.square, residual) / 18)


def test_the_gaussian_is_least_where_sigma_is_the_residual() -> None:
    residual, _, _ = numbers(())
    best = residual.abs().log()
    assert_close(gradient(lambda leaf: gaussian(residual, leaf), best), torch.zeros(21, 2))
    for off in (-0.1, 0.1):
        assert (gaussian(residual, best + off) > gaussian(residual, best)).all()


def test_the_laplace_is_least_where_its_scale_is_the_residual() -> None:
    """b* = |e|, so that σ* = √2 |e|."""
    residual, _, _ = numbers(())
    best = (math.sqrt(2) * residual.abs()).log()
    assert_close(gradient(lambda leaf: laplace(residual, leaf), best), torch.zeros(21, 2))
    for off in (-0.1, 0.1):
        assert (laplace(residual, best + off) > laplace(residual, best)).all()


def test_an_outlier_pulls_the_laplace_no_harder() -> None:
    log_sigma = torch.zeros(2)
    pull = gradient(lambda leaf: laplace(leaf, log_sigma), torch.tensor([3.0, 3000.0]))
    assert_close(pull, torch.full((2,), math.sqrt(2)))


def test_beta_one_pulls_the_mean_as_half_the_squared_error_does() -> None:
    residual, log_sigma, _ = numbers((4,))
    pull = gradient(lambda leaf: beta_gaussian(leaf, log_sigma, 1.0), residual)
    assert_close(pull, gradient(torch.square, residual) / 2)


def test_beta_zero_is_eq_7_and_beta_leaves_the_best_sigma_where_it_is() -> None:
    residual, log_sigma, _ = numbers((4,))
    assert_close(beta_gaussian(residual, log_sigma, 0.0), gaussian(residual, log_sigma))
    best = residual.abs().log()
    slope = gradient(lambda leaf: beta_gaussian(residual, leaf, 0.5), best)
    assert_close(slope, torch.zeros_like(slope))


def test_gradients_match_finite_differences() -> None:
    arguments = [argument.requires_grad_() for argument in numbers((2,))]
    assert torch.autograd.gradcheck(gaussian, arguments[:2])
    assert torch.autograd.gradcheck(laplace, arguments[:2])
    assert torch.autograd.gradcheck(full_gaussian, arguments)
    # The weight of β-NLL has no gradient by design, so only the gradient of the residual is compared.
    fixed = arguments[1].detach()
    assert torch.autograd.gradcheck(lambda leaf: beta_gaussian(leaf, fixed, 0.5), arguments[0])


def test_the_weight_of_beta_carries_no_gradient() -> None:
    residual, log_sigma, _ = numbers((2,))
    slope = gradient(lambda leaf: beta_gaussian(residual, leaf, 0.5), log_sigma)
    unweighted = gradient(lambda leaf: gaussian(residual, leaf), log_sigma)
    assert_close(slope, log_sigma.exp() * unweighted)
