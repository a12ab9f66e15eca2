"""Laplace's approximation: a Gaussian about a minimum of the loss, from its second derivatives (Sec. 3.3)."""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.second_order.least_squares import Model

SMALLEST: Final = 1e-7
"""Least curvature, as a share of the hand's largest: single precision has no smaller differences."""


def curvature_of(model: Model) -> Float[Tensor, "hand unknown unknown"]:
    """Second derivatives of the loss by the free unknowns, with the hinge where angles are outside.

    Args:
        model: The loss at the hands.
    """
    matrix = model.curvature.clone()
    if model.hinge is not None:
        _, outside = model.hinge.expanded(model.hinge.angles)
        matrix.diagonal(dim1=1, dim2=2)[:, : outside.shape[1]] += outside
    return matrix


def damped(
    matrix: Float[Tensor, "hand unknown unknown"],
) -> Float[Tensor, "hand unknown unknown"]:
    """Second derivatives with `SMALLEST` of each hand's largest one added along the diagonal.

    Args:
        matrix: Second derivatives of each hand, positive semi-definite.
    """
    diagonal = matrix.diagonal(dim1=1, dim2=2)
    added = SMALLEST * diagonal.amax(dim=1, keepdim=True).expand_as(diagonal)
    return matrix + torch.diag_embed(added)


def factor_of(model: Model) -> Float[Tensor, "hand unknown unknown"]:
    """Lower triangular L with L Lᵀ the curvature, in double precision.

    Args:
        model: The loss at the hands, with a prior that bounds every unknown.
    """
    return torch.linalg.cholesky(damped(curvature_of(model).double()))


def log_volume_of(
    factor: Float[Tensor, "hand unknown unknown"],
) -> Float[Tensor, " hand"]:
    """Logarithm of the volume of the Gaussian, up to a constant: −½ log det of the curvature.

    Args:
        factor: `factor_of` the hands.
    """
    return -factor.diagonal(dim1=1, dim2=2).log().sum(dim=1)


def covariance_of(model: Model) -> Float[Tensor, "hand unknown unknown"]:
    """Covariance of the free unknowns: the inverse of the curvature.

    Args:
        model: The loss at the hands, with a prior that bounds every unknown.
    """
    return torch.cholesky_inverse(factor_of(model)).to(model.curvature)
