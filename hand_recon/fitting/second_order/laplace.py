"""Laplace approximation: a Gaussian about the minimum of the loss, from its second derivatives (Sec. 3.3).

With a likelihood as data term, the loss is the negative logarithm of a posterior density up to a constant.
"""

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


def covariance_of(model: Model) -> Float[Tensor, "hand unknown unknown"]:
    """Covariance of the free unknowns: the inverse of the curvature.

    Args:
        model: The loss at the hands, with a prior that bounds every unknown.
    """
    matrix = curvature_of(model).double()
    diagonal = matrix.diagonal(dim1=1, dim2=2)
    diagonal += SMALLEST * diagonal.amax(dim=1, keepdim=True)
    factor = torch.linalg.cholesky(matrix)
    return torch.cholesky_inverse(factor).to(model.curvature)
