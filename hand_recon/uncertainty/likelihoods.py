"""Negative log-likelihoods of residuals, per coordinate or per landmark, without reduction (Sec. 3.3, Eq. 7).

As in Eq. 7, constants are left out: ½ log 2π per coordinate of a Gaussian and ½ log 2 per coordinate of a
Laplace distribution. σ is a standard deviation in all of them, so a predicted σ means the same under each.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def gaussian(
    residual: Float[Tensor, "*any"], log_sigma: Float[Tensor, "*any"]
) -> Float[Tensor, "*any"]:
    """Eq. 7: log σ + e² / (2σ²).

    Args:
        residual: e, any unit.
        log_sigma: Logarithm of σ in that unit.
    """
    return log_sigma + 0.5 * (residual * torch.exp(-log_sigma)).square()


def beta_gaussian(
    residual: Float[Tensor, "*any"], log_sigma: Float[Tensor, "*any"], beta: float
) -> Float[Tensor, "*any"]:
    """β-NLL: Eq. 7 times σ^2β, where σ^2β has no gradient (Seitzer et al., ICLR 2022).

    β = 0 is Eq. 7. With β = 1, the gradient on the mean is that of half the squared error, whatever σ is.

    Args:
        residual: e, any unit.
        log_sigma: Logarithm of σ in that unit.
        beta: 0 to 1; its authors advise ½.
    """
    return torch.exp(2 * beta * log_sigma).detach() * gaussian(residual, log_sigma)


def laplace(
    residual: Float[Tensor, "*any"], log_sigma: Float[Tensor, "*any"]
) -> Float[Tensor, "*any"]:
    """Log σ + √2 |e| / σ: a Laplace distribution of scale b = σ / √2 (log 2b + |e| / b).

    The gradient on the mean does not grow with the residual, so outliers have a bounded influence.

    Args:
        residual: e, any unit.
        log_sigma: Logarithm of the standard deviation σ in that unit.
    """
    return log_sigma + math.sqrt(2.0) * residual.abs() * torch.exp(-log_sigma)


def full_gaussian(
    residual: Float[Tensor, "*any 2"],
    log_sigma: Float[Tensor, "*any 2"],
    correlation: Float[Tensor, "*any"],
) -> Float[Tensor, "*any"]:
    """½ log det Σ + ½ eᵀ Σ⁻¹ e for a 2 × 2 covariance, since errors behind an occluder have a direction.

    Args:
        residual: e, any unit.
        log_sigma: Logarithms of σ_u and σ_v in that unit.
        correlation: ρ of the two coordinates, between −1 and 1.

    Returns:
        One value per landmark; without correlation, the sum of Eq. 7 over both coordinates.
    """
    standardised = residual * torch.exp(-log_sigma)
    along, across = standardised.sum(dim=-1), standardised[..., 0] - standardised[..., 1]
    # Equal to (u² − 2ρuv + v²) / (1 − ρ²), but as a sum of squares it cannot become negative by rounding.
    distance = 0.5 * (along.square() / (1 + correlation) + across.square() / (1 - correlation))
    log_determinant = torch.log1p(-correlation.square())
    return log_sigma.sum(dim=-1) + 0.5 * (log_determinant + distance)
