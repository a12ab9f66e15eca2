"""Bounds that leave the middle alone and never stop a gradient altogether (Sec. 3.3).

The paper bounds nothing. A σ of a thousandth of a pixel, though, makes one landmark outweigh all
others and every prior, and nothing on a 224-pixel crop is worth a σ of hundreds.
"""

import math
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

LOWEST_SIGMA: Final = 0.5
"""Pixels of a 224-pixel crop: no annotator is surer than that."""

HIGHEST_SIGMA: Final = 50.0
"""Pixels of a 224-pixel crop: a landmark that could be anywhere on the hand."""

BENT_SHARE: Final = 0.1
"""Share of the range, at either end, in which a bound is approached: σ is free from 0.8 to 31 px."""


def soft_bound(
    raw: Float[Tensor, "*any"],
    lower: float = math.log(LOWEST_SIGMA),
    upper: float = math.log(HIGHEST_SIGMA),
) -> Float[Tensor, "*any"]:
    """Bound log σ: the identity but for a tenth of the range at either end.

    A network that starts with all its σ far outside finds its way back: at ±30 the derivative is
    still above 1e-4, where a sigmoid's would be 1e-11.

    Args:
        raw: Any number.
        lower: Smallest log σ.
        upper: Largest log σ.
    """
    return soft_clamp(raw, lower, upper, margin=BENT_SHARE * (upper - lower))


def soft_clamp(
    value: Float[Tensor, "*any"], lower: float, upper: float, *, margin: float
) -> Float[Tensor, "*any"]:
    """The identity up to a margin before each bound, which it then approaches like a hyperbola.

    Continuous, and so is its derivative: one in the middle, (margin / (margin + excess))² beyond.
    """
    low, high = lower + margin, upper - margin
    above, below = (value - high).relu(), (low - value).relu()
    bend = margin * above / (margin + above) - margin * below / (margin + below)
    # Not the gradient of clamp: at a bound itself it depends on PyTorch's version whether there is one.
    outside = (above > 0) | (below > 0)
    return torch.where(outside, value.detach().clamp(low, high), value) + bend
