"""Factor of a network's σ, fitted to the residuals of hands that it was not trained on (decision 83).

Where a network fits the labels of its training closely, its σ are too small on other images. One factor for
all σ makes as many residuals lie within their interval as should.
"""

import math
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

LEVEL: Final = 0.80
"""Share of the residuals that the interval of this share holds with the factor."""

BOUNDS: Final = (0.05, 20.0)
"""Smallest and largest factor: beyond, something else is wrong."""

_HALVINGS: Final = 40


def sigma_factor(
    residual: Float[Tensor, " value"],
    sigma: Float[Tensor, " value"],
    given: Float[Tensor, " value"] | None = None,
) -> float:
    """Factor f with which `LEVEL` of the residuals are in the central interval of a Gaussian of σ f.

    Args:
        residual: Projections minus labels, pixels; not one need be within an interval.
        sigma: Predicted σ of each, pixels.
        given: σ of each label, if the predicted one is that of the network alone: the variances add up.

    Returns:
        The factor, within `BOUNDS`; 1 without a residual.
    """
    if not len(residual):
        return 1.0
    half = math.sqrt(2) * float(torch.erfinv(torch.tensor(LEVEL, dtype=torch.float64)))
    noise = torch.zeros_like(sigma) if given is None else given
    # As many as a new value needs, to be inside as often as said; rounding must not add one.
    wanted = min(len(residual), math.ceil(LEVEL * (len(residual) + 1) - 1e-9))
    low, high = (math.log(bound) for bound in BOUNDS)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        spread = torch.hypot(math.exp(middle) * sigma, noise)
        inside = int((residual.abs() <= half * spread).sum())
        low, high = (low, middle) if inside >= wanted else (middle, high)
    return math.exp(high)
