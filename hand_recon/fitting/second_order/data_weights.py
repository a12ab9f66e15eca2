"""Weights of the squared residuals in a data term (Sec. 3.3)."""

from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.uncertainty import (
    DataTerm,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
)

SMALLEST: Final = 0.3
"""Residual below which a weight no longer grows, pixels: a Laplace likelihood's has no bound."""


def is_quadratic(term: DataTerm) -> bool:
    """Return true if the term is a weighted sum of squared residuals plus a constant.

    Args:
        term: Data term, with its current stage.
    """
    if type(term) is Staged:
        return is_quadratic((term.first, term.second)[term.stage])
    return type(term) in (SquaredError, RescaledSquaredError, NegativeLogLikelihood)


def is_likelihood(term: DataTerm) -> bool:
    """Return true if the term is the negative logarithm of the landmarks' probability.

    Args:
        term: Data term, with its current stage.
    """
    if type(term) is Staged:
        # Balanced against the prior, it is a multiple of one.
        return not term.keep_balance and is_likelihood((term.first, term.second)[term.stage])
    if isinstance(term, NegativeLogLikelihood) and term.beta > 0:
        return False
    return term.learns_sigma


def data_weights(
    term: DataTerm,
    residual: Float[Tensor, "hand landmark=21 2"],
    log_sigma: Float[Tensor, "hand landmark=21 2"],
    labelled: Bool[Tensor, "hand landmark=21"],
) -> Float[Tensor, "hand landmark=21 2"]:
    """Derivatives of the term by the residuals, over the residuals.

    For a sum of squares they are the second derivatives and do not depend on the residuals; for other terms
    they are the weights of iteratively reweighted least squares.

    Args:
        term: Data term, one value per hand.
        residual: Projection minus label, pixels.
        log_sigma: Logarithm of σ of each coordinate, pixels.
        labelled: Landmarks that have a label.
    """
    with torch.enable_grad():
        away = residual.detach().masked_fill(~labelled[..., None], SMALLEST)
        sign = torch.where(away < 0, -1.0, 1.0)
        away = sign * away.abs().clamp(min=SMALLEST)
        away.requires_grad_()
        value = term(away, log_sigma, labelled).sum()
        (gradient,) = torch.autograd.grad(value, away)
    return (gradient / away.detach()).clamp(min=0)
