"""Every data term: one finite value per hand for any labels and any numbers."""

import itertools
import math

import pytest
import torch
from torch import Tensor

from hand_recon.uncertainty import (
    DataTerm,
    FullCovariance,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
)
from tests.support.tolerance import BATCH_SHAPES, assert_close

TERMS = {
    "mse": SquaredError(),
    "mse_rescaled": RescaledSquaredError(sigma=3.0),
    "nll": NegativeLogLikelihood(),
    "beta_nll": NegativeLogLikelihood(beta=0.5),
    "laplace": LaplaceLikelihood(),
    "full_covariance": FullCovariance(),
    "staged": Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5),
}
every_term = pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)


def everything(shape: tuple[int, ...]) -> Tensor:
    return torch.ones(*shape, 21, dtype=torch.bool)


def numbers(shape: tuple[int, ...], dtype: torch.dtype = torch.float64) -> list[Tensor]:
    """Residual, log σ and correlation."""
    return [
        5 * torch.randn(*shape, 21, 2, dtype=dtype),
        1 + torch.randn(*shape, 21, 2, dtype=dtype),
        torch.rand(*shape, 21, dtype=dtype) * 1.8 - 0.9,
    ]


def test_five_pixels_everywhere_cost_1050() -> None:
    """The balance with λ₁ of decision 7: 42 coordinates times 25."""
    residual = torch.full((21, 2), 5.0)
    assert SquaredError()(residual, torch.zeros(21, 2), everything(())) == pytest.approx(1050.0)


def test_five_pixels_everywhere_with_a_sigma_of_five_cost_89() -> None:
    """42 · (log 5 + ½) = 88.6: the data term after the switch."""
    residual = torch.full((21, 2), 5.0)
    value = NegativeLogLikelihood()(residual, residual.log(), everything(()))
    assert float(value) == pytest.approx(88.596, abs=1e-3)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
@every_term
def test_each_hand_has_its_own_value(term: DataTerm, shape: tuple[int, ...]) -> None:
    residual, log_sigma, correlation = numbers(shape)
    values = term(residual, log_sigma, everything(shape), correlation)
    flat = zip(
        residual.reshape(-1, 21, 2),
        log_sigma.reshape(-1, 21, 2),
        correlation.reshape(-1, 21),
        strict=True,
    )
    alone = [term(r, s, everything(()), c) for r, s, c in flat]
    assert_close(values, torch.stack(alone).reshape(shape))


@every_term
def test_unlabelled_landmarks_cost_nothing_and_pull_at_nothing_even_as_nan(term: DataTerm) -> None:
    residual, log_sigma, correlation = numbers((), torch.float32)
    leaves = [tensor.requires_grad_() for tensor in (residual, log_sigma, correlation)]
    labels = torch.zeros(21, 2)
    labels[5:] = float("nan")
    labelled = torch.arange(21) < 5
    value = term(residual - labels, log_sigma, labelled, correlation)
    # Equal to the mean of five hands, each of which has one of the five landmarks 21 times.
    repeated = torch.arange(105) // 21
    few = [tensor.detach()[repeated].reshape(5, 21, *tensor.shape[1:]) for tensor in leaves]
    assert_close(value, term(few[0], few[1], everything((5,)), few[2]).mean())
    value.backward()
    for leaf in leaves:
        gradient = torch.zeros_like(leaf) if leaf.grad is None else leaf.grad
        assert torch.isfinite(gradient).all()
        assert (gradient[5:] == 0).all()


@every_term
def test_a_hand_without_labels_costs_nothing(term: DataTerm) -> None:
    nothing = torch.zeros(21, dtype=torch.bool)
    residual = torch.full((21, 2), float("nan"))
    assert term(residual, torch.full((21, 2), 2.0), nothing, torch.zeros(21)) == 0


WILD = list(
    itertools.product((-100.0, -12.0, 0.0, 12.0, 100.0), (0.0, 1e-30, -1e6, 1e6), (-1.0, 0.0, 1.0))
)
"""log σ, residual and correlation far outside the usual range."""


@every_term
def test_no_number_is_too_wild_for_single_precision(term: DataTerm) -> None:
    for log_sigma, residual, correlation in WILD:
        leaves = [
            torch.full((21, 2), residual).requires_grad_(),
            torch.full((21, 2), log_sigma).requires_grad_(),
            torch.full((21,), correlation).requires_grad_(),
        ]
        value = term(leaves[0], leaves[1], everything(()), leaves[2])
        assert torch.isfinite(value), (log_sigma, residual, correlation)
        value.backward()
        gradients = [leaf.grad for leaf in leaves if leaf.grad is not None]
        assert leaves[0].grad is not None
        assert torch.cat([gradient.flatten() for gradient in gradients]).isfinite().all()


def test_the_guards_change_nothing_in_a_sane_range() -> None:
    """σ from a ten-thousandth of a pixel to 20,000, and correlations up to 0.99."""
    residual = torch.ones(21, 2, dtype=torch.float64)
    log_sigma = torch.linspace(-9.5, 9.9, 42, dtype=torch.float64).reshape(21, 2)
    value = NegativeLogLikelihood()(residual, log_sigma, everything(()))
    assert_close(value, (log_sigma + 0.5 * torch.exp(-2 * log_sigma)).sum())
    level = torch.zeros_like(log_sigma)
    correlation = torch.full((21,), 0.99, dtype=torch.float64)
    value = FullCovariance()(residual, level, everything(()), correlation)
    assert float(value) == pytest.approx(21 * (0.5 * math.log(1 - 0.99**2) + 1 / 1.99))


@pytest.mark.parametrize("log_sigma", [-100.0, 100.0])
@pytest.mark.parametrize("name", ["nll", "beta_nll", "laplace", "full_covariance"])
def test_a_sigma_far_outside_is_still_drawn_back(name: str, log_sigma: float) -> None:
    leaf = torch.full((21, 2), log_sigma, requires_grad=True)
    TERMS[name](torch.ones(21, 2), leaf, everything(()), torch.zeros(21)).backward()
    assert leaf.grad is not None
    assert (leaf.grad.sign() == math.copysign(1, log_sigma)).all()


@pytest.mark.parametrize("name", ["mse", "mse_rescaled", "nll", "laplace", "full_covariance"])
def test_gradient_matches_finite_differences(name: str) -> None:
    labelled = torch.arange(21) != 4
    leaves = [tensor.requires_grad_() for tensor in numbers((2,))]

    def value(residual: Tensor, log_sigma: Tensor, correlation: Tensor) -> Tensor:
        return TERMS[name](residual, log_sigma, labelled.expand(2, 21), correlation)

    assert torch.autograd.gradcheck(value, leaves)


def test_the_rescaled_error_is_eq_7_with_one_sigma_up_to_a_constant() -> None:
    residual, _, _ = numbers((4,))
    log_sigma = torch.full_like(residual, math.log(3.0))
    rescaled = RescaledSquaredError(sigma=3.0)(residual, log_sigma, everything((4,)))
    likelihood = NegativeLogLikelihood()(residual, log_sigma, everything((4,)))
    assert_close(likelihood - rescaled, torch.full((4,), 42 * math.log(3.0)))


def test_the_rescaled_error_is_the_squared_error_until_start_is_called() -> None:
    residual, log_sigma, _ = numbers((4,))
    squared = SquaredError()(residual, log_sigma, everything((4,)))
    rescaled = RescaledSquaredError().double()(residual, log_sigma, everything((4,)))
    torch.testing.assert_close(rescaled, squared, rtol=1e-6, atol=0)


def test_only_a_full_covariance_needs_a_correlation() -> None:
    assert [name for name, term in TERMS.items() if term.needs_correlation] == ["full_covariance"]
    residual, log_sigma, _ = numbers(())
    with pytest.raises(ValueError, match=r"none was predicted.*model.correlated=true"):
        FullCovariance()(residual, log_sigma, everything(()))
    second = Staged(SquaredError(), FullCovariance(), switch_at=0.5)
    assert second.needs_correlation


@pytest.mark.parametrize("name", ["mse", "mse_rescaled", "nll", "laplace", "full_covariance"])
def test_a_term_of_one_stage_answers_what_training_asks_of_all(name: str) -> None:
    term = TERMS[name]
    residual, _, _ = numbers((3,))
    before = {key: value.clone() for key, value in term.state_dict().items()}
    assert not any(term.begin(step=step, epoch=step, total_steps=3) for step in range(3))
    term.observe(residual, everything((3,)))
    assert (term.stage, term.stages) == (0, 1)
    assert all(torch.equal(value, before[key]) for key, value in term.state_dict().items())
    with pytest.raises(RuntimeError, match="single stage"):
        term.running_log_sigma()


def test_parameters_without_meaning_are_refused() -> None:
    with pytest.raises(ValueError, match="beta lies between 0"):
        NegativeLogLikelihood(beta=2.0)
    with pytest.raises(ValueError, match="positive, found sigma=0"):
        RescaledSquaredError(sigma=0.0)
