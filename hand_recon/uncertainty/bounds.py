"""Smooth bounds of log σ: the identity in the middle, a gradient above zero everywhere (Sec. 3.3).

The paper has no bounds. But with a σ of a thousandth of a pixel, one landmark outweighs all others and the
prior, and on a 224-pixel crop a σ of hundreds of pixels has no meaning.
"""

import math
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

LOWEST_SIGMA: Final = 0.5
"""Smallest σ, pixels of a 224-pixel crop: no annotator is more precise."""

HIGHEST_SIGMA: Final = 50.0
"""Largest σ, pixels of a 224-pixel crop: the landmark could be anywhere on the hand."""

BENT_SHARE: Final = 0.1
"""Share of the range, at either end, over which a bound is approached: σ is unchanged from 0.8 to 31 px."""


def soft_bound(
    raw: Float[Tensor, "*any"],
    lower: float = math.log(LOWEST_SIGMA),
    upper: float = math.log(HIGHEST_SIGMA),
) -> Float[Tensor, "*any"]:
    """Bound log σ: the identity except for a tenth of the range at either end.

    A network that starts with σ far outside the bounds can return: at ±30 the derivative is still above 1e-4,
    where a sigmoid's would be 1e-11.

    Args:
        raw: Unbounded log σ.
        lower: Smallest log σ.
        upper: Largest log σ.
    """
    return soft_clamp(raw, lower, upper, margin=BENT_SHARE * (upper - lower))


def soft_clamp(
    value: Float[Tensor, "*any"], lower: float, upper: float, *, margin: float
) -> Float[Tensor, "*any"]:
    """Smooth clamp: the identity up to a margin before each bound, then a hyperbola towards the bound.

    The derivative is continuous: one in the middle, (margin / (margin + excess))² beyond.

    Args:
        value: Any number.
        lower: Lower bound.
        upper: Upper bound.
        margin: Distance from each bound at which the identity ends.
    """
    low, high = lower + margin, upper - margin
    above, below = (value - high).relu(), (low - value).relu()
    bend = margin * above / (margin + above) - margin * below / (margin + below)
    # Without the gradient of clamp: its value exactly at a bound depends on PyTorch's version.
    outside = (above > 0) | (below > 0)
    return torch.where(outside, value.detach().clamp(low, high), value) + bend
