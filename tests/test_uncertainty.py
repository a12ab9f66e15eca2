"""The data term."""

import pytest
import torch

from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError
from tests.tolerance import BATCH_SHAPES


def everything(shape: tuple[int, ...]) -> torch.Tensor:
    return torch.ones(*shape, 21, dtype=torch.bool)


def test_five_pixels_everywhere_cost_1050() -> None:
    """The balance with λ₁ that docs/decisions.md starts from: 42 coordinates times 25."""
    residual = torch.full((21, 2), 5.0)
    assert SquaredError()(residual, torch.zeros(21, 2), everything(())) == pytest.approx(1050.0)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_each_hand_has_its_own_value(shape: tuple[int, ...]) -> None:
    residual = torch.randn(*shape, 21, 2)
    value = SquaredError()(residual, residual, everything(shape))
    torch.testing.assert_close(value, residual.square().sum(dim=(-2, -1)))


def test_unlabelled_landmarks_cost_nothing_even_as_nan() -> None:
    prediction = torch.zeros(21, 2, requires_grad=True)
    labels = torch.full((21, 2), 3.0)
    labels[5:] = float("nan")
    labelled = torch.arange(21) < 5
    value = SquaredError()(prediction - labels, torch.zeros(21, 2), labelled)
    value.backward()
    assert prediction.grad is not None
    assert value.item() == pytest.approx(21 * 2 * 9.0)
    assert torch.isfinite(prediction.grad).all()
    assert (prediction.grad[5:] == 0).all()


def test_a_hand_without_labels_costs_nothing() -> None:
    nothing = torch.zeros(21, dtype=torch.bool)
    assert SquaredError()(torch.full((21, 2), float("nan")), torch.zeros(21, 2), nothing) == 0


def test_the_likelihood_that_is_not_there_yet_is_refused_plainly() -> None:
    with pytest.raises(NotImplementedError, match="data_term=mse"):
        NegativeLogLikelihood()
