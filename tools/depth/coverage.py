"""Whether the 3D covariances of fitted landmarks cover their errors."""

from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from depth.comparison import Scored
from depth.scores import Mean, grouped_mean
from hand_recon.hand.skeleton import ROOT_LANDMARK

LIMITS: Final = (3.527, 8.025)
"""Squared Mahalanobis distances within which a Gaussian in three dimensions has the shares of one and two σ,
0.683 and 0.954: quantiles of χ² with three degrees of freedom."""


@dataclass(frozen=True)
class Coverage:
    """Errors of landmarks from the hand's root beside their covariances."""

    within_one: Mean
    """Share of the landmarks within one σ; of a Gaussian 0.683."""
    within_two: Mean
    """Share of the landmarks within two σ; of a Gaussian 0.954."""
    rank_correlation: float
    """Spearman's correlation of the size of an error and of the σ that was given."""

    @classmethod
    def of(cls, scored: Scored) -> Self | None:
        """Compare errors and covariances; none for a fit without covariances.

        One view does not give the size of a hand, so that the fit is scaled about the root to meet the ground
        truth best. It is not rotated.

        Args:
            scored: The run.
        """
        covariances = [part.prediction.covariance_3d for part in scored.run.parts]
        known = [each for each in covariances if each is not None]
        if len(known) < len(covariances):
            return None
        covariance = torch.cat(known).double()
        found, expected = (
            points - points[:, ROOT_LANDMARK, None]
            for points in (scored.run.landmarks_3d, scored.hands.ground_truth)
        )
        scale = (found * expected).sum(dim=(1, 2)) / found.square().sum(dim=(1, 2))
        others = [each for each in range(21) if each != ROOT_LANDMARK]
        error = (scale[:, None, None] * found - expected)[:, others]
        spread = (scale[:, None, None, None].square() * covariance)[:, others]
        distance = (error * torch.linalg.solve(spread, error[..., None])[..., 0]).sum(dim=-1)
        groups = scored.hands.groups
        sigma = spread.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
        return cls(
            *(grouped_mean((distance < limit).double().mean(dim=1), groups) for limit in LIMITS),
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
        "| set | method | within 1 σ (Gaussian: 0.683) | within 2 σ (0.954) | rank correlation |",
        "|" + " --- |" * 5,
    ]
    for one, found in rows:
        lines.append(
            f"| {one.hands.name} | {one.run.method.name} | {found.within_one} | {found.within_two} "
            f"| {found.rank_correlation:.2f} |"
        )
    return "\n".join(lines)
