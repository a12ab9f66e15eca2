"""Distances between corresponding points, and the area under their PCK curve (Sec. 4.1, E and AUC)."""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

AUC_LIMIT: Final = 0.05
"""Largest threshold of the PCK curve, metres: 50 mm (Sec. 4.1)."""

AUC_STEPS: Final = 100
"""Number of thresholds from zero to the largest, both included, as in the official scripts."""


def point_errors(
    ground_truth: Float[Tensor, "*batch point 3"], prediction: Float[Tensor, "*batch point 3"]
) -> Float[Tensor, "*batch point"]:
    """Distance of each point from its ground truth, in the points' unit, in double precision."""
    return torch.linalg.vector_norm(ground_truth.double() - prediction.double(), dim=-1)


def auc(errors: Float[Tensor, "*batch point"], limit: float = AUC_LIMIT) -> Float[Tensor, "*batch"]:
    """Area under the PCK curve, the share of points within a threshold, as a fraction of the largest area.

    The official scripts make one curve per point over all frames, integrate it by the trapezoid rule and
    average over points. Every frame has every point, and the trapezoid rule is linear, so that the mean
    over hands of the values returned here is the same. A constant error of 10 mm gives 0.80303, an exact
    zero 1, and the smallest other error 98.5 / 99.

    Args:
        errors: Distances, in the unit of `limit`.
        limit: Largest threshold.

    Returns:
        One value per hand, 0 to 1.
    """
    # NumPy's thresholds, to the last bit: an error may equal one.
    thresholds = torch.from_numpy(np.linspace(0.0, limit, AUC_STEPS)).to(errors.device)
    areas = _areas_of_steps(thresholds) / limit
    return areas[torch.searchsorted(thresholds, errors.double().contiguous())].mean(dim=-1)


def _areas_of_steps(thresholds: Float[Tensor, " step"]) -> Float[Tensor, " step+1"]:
    """Area under a step curve that is 1 from the i-th threshold on; 0 for an error above all thresholds."""
    half_widths = thresholds.diff() / 2
    zero = torch.zeros_like(thresholds[:1])
    weights = torch.cat([half_widths, zero]) + torch.cat([zero, half_widths])
    return torch.cat([weights.flip(0).cumsum(0).flip(0), zero])
