"""The likelihood on labels of unequal noise (Sec. 3.3), on problems with known solutions."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor
from torch.distributions import Laplace

from hand_recon.uncertainty import (
    DataTerm,
    FullCovariance,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
    soft_bound,
)

NOISE = torch.where(torch.arange(21) < 10, 2.0, 16.0).double()
"""σ of the labels, pixels: ten landmarks in sight and eleven hidden."""

SAMPLES = 4000


def everything(hands: int) -> Tensor:
    return torch.ones(hands, 21, dtype=torch.bool)


def minimise(parameters: list[Tensor], loss: Callable[[], Tensor]) -> None:
    """Descend to the nearest minimum."""
    optimizer = torch.optim.LBFGS(
        parameters, max_iter=500, tolerance_change=1e-12, line_search_fn="strong_wolfe"
    )

    def closure() -> Tensor:
        optimizer.zero_grad()
        value = loss()
        value.backward()
        return value

    optimizer.step(closure)


@dataclass
class LinearHands:
    """Forty hands with noisy labels, and a linear network from eight features to six numbers."""

    features: Tensor
    basis: Tensor
    ground_truth: Tensor
    labels: Tensor
    weights: Tensor
    log_sigma: Tensor

    @classmethod
    def drawn(cls, seed: int) -> "LinearHands":
        generator = torch.Generator().manual_seed(seed)

        def normal(*shape: int) -> Tensor:
            return torch.randn(*shape, generator=generator, dtype=torch.float64)

        features, basis = normal(40, 8), 15 * normal(6, 42)
        ground_truth = (features @ normal(8, 6) / math.sqrt(8) @ basis).unflatten(-1, (21, 2))
        labels = ground_truth + NOISE[:, None] * normal(40, 21, 2)
        weights, log_sigma = torch.zeros(8, 6).double(), torch.zeros(21, 2).double()
        return cls(
            features,
            basis,
            ground_truth,
            labels,
            weights.requires_grad_(),
            log_sigma.requires_grad_(),
        )

    def projected(self) -> Tensor:
        return (self.features @ self.weights @ self.basis).unflatten(-1, (21, 2))

    def train(self, term: DataTerm) -> None:
        """Train until convergence, with a weak prior, so that the data term's weight matters."""

        def loss() -> Tensor:
            log_sigma = soft_bound(self.log_sigma).expand_as(self.labels)
            data = term(self.projected() - self.labels, log_sigma, everything(40)).sum()
            return data + 0.5 * (self.features @ self.weights).square().sum()

        minimise([self.weights, self.log_sigma], loss)

    @torch.no_grad()
    def error(self) -> float:
        """Mean distance to the ground truth landmarks, which are not used in training, pixels."""
        return float((self.projected() - self.ground_truth).norm(dim=-1).mean())

    def train_staged(self, second: DataTerm) -> float:
        """Train with the paper's schedule, each stage until convergence."""
        term = Staged(SquaredError(), second, switch_at=1, unit="step").double()
        self.train(term)
        term.observe(self.projected() - self.labels, everything(40))
        assert term.begin(step=1, epoch=0, total_steps=2)
        with torch.no_grad():
            self.log_sigma.copy_(term.running_log_sigma())
        self.train(term)
        return self.error()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_with_unequal_noise_the_likelihood_beats_the_squared_error_rescaled_or_not(
    seed: int,
) -> None:
    """It also finds the σ of the labels."""
    hands = LinearHands.drawn(seed)
    hands.train(SquaredError())
    squared_error = hands.error()
    rescaled = LinearHands.drawn(seed).train_staged(RescaledSquaredError())
    hands = LinearHands.drawn(seed)
    likelihood = hands.train_staged(NegativeLogLikelihood())
    assert likelihood < 0.5 * squared_error
    assert likelihood < 0.5 * rescaled
    sigma = hands.log_sigma.detach().exp()
    # Four standard errors of the mean, plus the overfitting of 48 weights to 40 hands.
    assert float(sigma[:10].mean()) == pytest.approx(2.0, rel=0.15)
    assert float(sigma[10:].mean()) == pytest.approx(16.0, rel=0.15)


def test_with_equal_noise_the_rescaled_error_is_all_that_the_likelihood_does() -> None:
    """Control: with one σ for all labels, all landmarks have the same weight, and both agree."""
    errors = []
    for second in (RescaledSquaredError(), NegativeLogLikelihood()):
        hands = LinearHands.drawn(3)
        hands.labels = (
            hands.ground_truth + 6.0 * (hands.labels - hands.ground_truth) / NOISE[:, None]
        )
        errors.append(hands.train_staged(second))
    assert errors[1] == pytest.approx(errors[0], rel=0.1)


def test_the_best_sigma_is_the_one_that_the_residuals_were_drawn_from() -> None:
    residual = NOISE[:, None] * torch.randn(SAMPLES, 21, 2, dtype=torch.float64)
    log_sigma = torch.full((21, 2), 1.5, dtype=torch.float64, requires_grad=True)
    term = NegativeLogLikelihood()
    minimise(
        [log_sigma],
        lambda: term(residual, log_sigma.expand_as(residual), everything(SAMPLES)).mean(),
    )
    # Four standard errors, each σ / √(2 · 4000).
    ratio = log_sigma.detach().exp() / NOISE[:, None]
    assert float((ratio - 1).abs().max()) < 4 / math.sqrt(2 * SAMPLES)


def test_the_laplace_finds_the_sigma_of_laplace_residuals() -> None:
    scale = (NOISE / math.sqrt(2))[:, None].expand(21, 2)
    residual = Laplace(torch.zeros_like(scale), scale).sample((SAMPLES,))
    log_sigma = torch.full((21, 2), 1.5, dtype=torch.float64, requires_grad=True)
    term = LaplaceLikelihood()
    minimise(
        [log_sigma],
        lambda: term(residual, log_sigma.expand_as(residual), everything(SAMPLES)).mean(),
    )
    ratio = log_sigma.detach().exp() / NOISE[:, None]
    assert float((ratio - 1).abs().max()) < 4 / math.sqrt(SAMPLES)


def test_a_full_covariance_finds_the_direction_of_the_errors() -> None:
    """Errors drawn with ρ = −0.8: found within four standard errors, (1 − ρ²) / √4000 = 0.006."""
    first, second = torch.randn(2, SAMPLES, 21, dtype=torch.float64)
    residual = torch.stack([first, -0.8 * first + 0.6 * second], dim=-1) * NOISE[:, None]
    log_sigma = torch.full((21, 2), 1.5, dtype=torch.float64, requires_grad=True)
    raw = torch.zeros(21, dtype=torch.float64, requires_grad=True)
    term = FullCovariance()

    def loss() -> Tensor:
        correlation = raw.tanh().expand(SAMPLES, 21)
        return term(
            residual, log_sigma.expand_as(residual), everything(SAMPLES), correlation
        ).mean()

    minimise([log_sigma, raw], loss)
    assert float((raw.detach().tanh() + 0.8).abs().max()) < 4 * 0.36 / math.sqrt(SAMPLES)
    ratio = log_sigma.detach().exp() / NOISE[:, None]
    assert float((ratio - 1).abs().max()) < 4 / math.sqrt(2 * SAMPLES)
