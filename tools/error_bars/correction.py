"""Fits a correction of covariances to errors: maximum likelihood, then quantiles of what it leaves."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor

from error_bars.errors import MEASURED, Errors
from hand_recon.evaluation.calibration_3d import region_bound, squared_mahalanobis
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.uncertainty.covariance_correction import LEVELS, CovarianceCorrection

GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "palm": ("wrist", "thumb CMC", "index MCP", "middle MCP", "ring MCP", "little MCP"),
    "first joints": ("thumb MCP", "index PIP", "middle PIP", "ring PIP", "little PIP"),
    "second joints": ("thumb IP", "index DIP", "middle DIP", "ring DIP", "little DIP"),
    "tips": ("thumb tip", "index tip", "middle tip", "ring tip", "little tip"),
}
"""Landmarks that share a correction: those of like distance from the root."""

START: Final = (1.5, 0.003, 0.006)
"""Scale, and added standard deviations across and along the line of sight in metres, where the fit begins."""

CENTRE: Final = 0.80
"""Level at which corrected covariances hold their share: errors of the other two then go opposite ways."""

STEPS: Final = 60


def fit_correction(sets: Sequence[Errors]) -> list[dict[str, Any]]:
    """Groups of a correction, as in the shipped table, from sets that count equally whatever their size.

    Args:
        sets: Errors with the covariances of Laplace's approximation.
    """
    return [_fit_group(name, sets) for name in GROUPS]


def _fit_group(name: str, sets: Sequence[Errors]) -> dict[str, Any]:
    landmarks = GROUPS[name]
    logs = torch.tensor([math.log(value) for value in START], dtype=torch.float64)
    logs.requires_grad_()
    optimizer = torch.optim.LBFGS([logs], max_iter=STEPS, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimizer.zero_grad()
        value = torch.stack([_surprise(*_rows(one, landmarks, logs.exp())) for one in sets]).mean()
        value.backward()
        return value

    optimizer.step(loss)
    with torch.no_grad():
        values = logs.exp()
        distances = [squared_mahalanobis(*_rows(one, landmarks, values)) for one in sets]
    factors = [quantile(distances, level) / region_bound(level, 3) for level in LEVELS]
    centre = factors[LEVELS.index(CENTRE)]
    scale, across, depth = (values * math.sqrt(centre)).tolist()
    return {
        "name": name,
        "landmarks": list(landmarks),
        "scale": round(scale, 3),
        "across_mm": round(1e3 * across, 2),
        "depth_mm": round(1e3 * depth, 2),
        "factors": [round(factor / centre, 3) for factor in factors],
    }


def _rows(
    errors: Errors, landmarks: Sequence[str], values: Float[Tensor, "3"]
) -> tuple[Float[Tensor, "row 3"], Float[Tensor, "row 3 3"]]:
    """Errors and corrected covariances of some landmarks of all hands."""
    scale, across, depth = (value.expand(21) for value in values)
    correction = CovarianceCorrection(scale, across, depth, torch.ones(21, 3))
    places = [place for place in MEASURED if LANDMARKS[place] in landmarks]
    covariance = errors.covariance(correction)[:, places]
    return errors.error[:, places].flatten(0, 1), covariance.flatten(0, 1)


def _surprise(error: Float[Tensor, "row 3"], covariance: Float[Tensor, "row 3 3"]) -> Tensor:
    """Mean negative logarithm of a Gaussian's density, up to a constant."""
    distance = squared_mahalanobis(error, covariance)
    return (torch.linalg.slogdet(covariance).logabsdet + distance).mean() / 2


def quantile(parts: Sequence[Float[Tensor, " value"]], level: float) -> float:
    """Conformal quantile of values of several sets that count equally.

    Args:
        parts: Values of each set.
        level: Share of new values that should be at most as large; of n values, ⌈level (n + 1)⌉ are.

    Returns:
        The quantile; the largest value if there are too few for the level.
    """
    values = torch.cat(list(parts))
    weights = torch.cat([torch.full_like(part, 1 / (len(parts) * len(part))) for part in parts])
    order = values.argsort()
    reached = weights[order].cumsum(dim=0)
    wanted = level * (1 + 1 / len(values))
    # Rounding of the sum must not skip a value.
    place = int(torch.searchsorted(reached, wanted - 1e-12))
    return float(values[order][min(place, len(values) - 1)])
