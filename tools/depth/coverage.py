"""Coverage of the errors of fitted landmarks by their 3D covariances."""

from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from depth.comparison import Scored
from depth.scores import Mean, grouped_mean

LIMITS: Final = {"50 %": 2.366, "90 %": 6.251, "95 %": 7.815}
"""Squared Mahalanobis distances within which a Gaussian in three dimensions has these shares: quantiles of χ²
with three degrees of freedom."""


@dataclass(frozen=True)
class Coverage:
    """Errors of landmarks in the camera's axes beside their covariances."""

    within: tuple[Mean, ...]
    """Percentage of the landmarks within each of `LIMITS`."""
    rank_correlation: float
    """Spearman's correlation of the size of an error and of the σ that was given."""

    @classmethod
    def of(cls, scored: Scored) -> Self | None:
        """Compare errors and covariances; none for a fit without covariances.

        One view does not give the size of a hand, and the hand's origin, which the covariances are about, is
        no landmark. So the fit is scaled and moved to meet the ground truth best; it is not rotated.

        Args:
            scored: The run.
        """
        covariances = [part.prediction.covariance_3d for part in scored.run.parts]
        known = [each for each in covariances if each is not None]
        if len(known) < len(covariances):
            return None
        found, expected = (
            points - points.mean(dim=1, keepdim=True)
            for points in (scored.run.landmarks_3d, scored.hands.ground_truth)
        )
        scale = (found * expected).sum(dim=(1, 2)) / found.square().sum(dim=(1, 2))
        error = scale[:, None, None] * found - expected
        spread = scale[:, None, None, None].square() * torch.cat(known).double()
        distance = (error * torch.linalg.solve(spread, error[..., None])[..., 0]).sum(dim=-1)
        sigma = spread.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
        return cls(
            tuple(
                grouped_mean(100 * (distance < limit).double().mean(dim=1), scored.hands.groups)
                for limit in LIMITS.values()
            ),
            _rank_correlation(error.norm(dim=-1).flatten(), sigma.flatten()),
        )


def _rank_correlation(one: Float[Tensor, " value"], other: Float[Tensor, " value"]) -> float:
    """Spearman's rank correlation of values without ties."""
    ranks = torch.stack([each.argsort().argsort().double() for each in (one, other)])
    return float(torch.corrcoef(ranks)[0, 1])


def markdown_coverage(scored: list[Scored]) -> str:
    """Table of the coverage of all runs that have covariances; empty without one.

    Args:
        scored: The runs.
    """
    rows = [(one, coverage) for one in scored if (coverage := Coverage.of(one)) is not None]
    if not rows:
        return ""
    lines = [
        "| set | method | "
        + "".join(f"within {name} | " for name in LIMITS)
        + "rank correlation |",
        "|" + " --- |" * (len(LIMITS) + 3),
    ]
    for one, found in rows:
        shares = " | ".join(
            f"{share.value:.0f} ({share.interval.low:.0f} … {share.interval.high:.0f})"
            for share in found.within
        )
        lines.append(
            f"| {one.hands.name} | {one.run.method.name} | {shares} | {found.rank_correlation:.2f} |"
        )
    return "\n".join(lines)
