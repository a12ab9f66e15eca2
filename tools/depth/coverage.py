"""Coverage of the errors of fitted landmarks by their 3D covariances."""

from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from depth.comparison import Scored
from depth.scores import Mean, grouped_mean
from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK

LIMITS: Final = {"50 %": 2.366, "90 %": 6.251, "95 %": 7.815}
"""Squared Mahalanobis distances within which a Gaussian in three dimensions has these shares: quantiles of χ²
with three degrees of freedom."""

_OTHERS: Final = [place for place in range(len(LANDMARKS)) if place != ROOT_LANDMARK]


@dataclass(frozen=True)
class Coverage:
    """Errors of landmarks in the camera's axes beside their covariances."""

    within: tuple[Mean, ...]
    """Percentage of the landmarks within each of `LIMITS`."""
    rank_correlation: float
    """Spearman's correlation of the size of an error and of the σ that was given."""

    @classmethod
    def of(cls, scored: Scored, *, aligned: bool = True) -> Self | None:
        """Compare errors and covariances; none for a fit without covariances.

        One view does not give the size of a hand, and the hand's origin, which the covariances are about, is
        not in every ground truth. So the fit is scaled and moved to meet the ground truth best; it is not
        rotated. Without this alignment, both are taken from the origin in metres, which is the quantity of
        `covariance_3d` in a file of hands; the middle MCP is then the ground truth's origin, so it is no
        error and is left out.

        Args:
            scored: The run.
            aligned: False to compare positions from the origin as they are.
        """
        covariances = [part.prediction.covariance_3d for part in scored.run.parts]
        known = [each for each in covariances if each is not None]
        if len(known) < len(covariances):
            return None
        scale, error = _aligned(scored) if aligned else _from_origin(scored)
        spread = scale[:, None, None, None].square() * torch.cat(known).double()
        if not aligned:
            error, spread = error[:, _OTHERS], spread[:, _OTHERS]
        distance = (error * torch.linalg.solve(spread, error[..., None])[..., 0]).sum(dim=-1)
        sigma = spread.diagonal(dim1=-2, dim2=-1).sum(dim=-1)
        return cls(
            tuple(
                grouped_mean(100 * (distance < limit).double().mean(dim=1), scored.hands.groups)
                for limit in LIMITS.values()
            ),
            _rank_correlation(error.norm(dim=-1).flatten(), sigma.flatten()),
        )


_Scale = Float[Tensor, " hand"]
_Errors = Float[Tensor, "hand landmark=21 3"]


def _aligned(scored: Scored) -> tuple[_Scale, _Errors]:
    """Scale of the fit and its errors, metres, after the best scale and translation."""
    found, expected = (
        points - points.mean(dim=1, keepdim=True)
        for points in (scored.run.landmarks_3d, scored.hands.ground_truth)
    )
    scale = (found * expected).sum(dim=(1, 2)) / found.square().sum(dim=(1, 2))
    return scale, scale[:, None, None] * found - expected


def _from_origin(scored: Scored) -> tuple[_Scale, _Errors]:
    """Scale one, and errors of the positions from the hand's origin, metres."""
    origin = torch.cat([part.prediction.parameters.translation for part in scored.run.parts])
    found = scored.run.landmarks_3d - origin.double()[:, None]
    truth = scored.hands.ground_truth
    expected = truth - truth[:, ROOT_LANDMARK, None]
    return torch.ones_like(found[:, 0, 0]), found - expected


def _rank_correlation(one: Float[Tensor, " value"], other: Float[Tensor, " value"]) -> float:
    """Spearman's rank correlation of values without ties."""
    ranks = torch.stack([each.argsort().argsort().double() for each in (one, other)])
    return float(torch.corrcoef(ranks)[0, 1])


def markdown_coverage(scored: list[Scored]) -> str:
    """Table of the coverage of all runs that have covariances; empty without one.

    Args:
        scored: The runs.
    """
    kinds = {"scaled and moved": True, "from the origin": False}
    lines = [
        "| set | method | "
        + "".join(f"{kind}, within {name} | " for kind in kinds for name in LIMITS)
        + "rank correlation |",
        "|" + " --- |" * (len(kinds) * len(LIMITS) + 3),
    ]
    for one in scored:
        found = [Coverage.of(one, aligned=aligned) for aligned in kinds.values()]
        known = [coverage for coverage in found if coverage is not None]
        if known:
            shares = " | ".join(_share(share) for coverage in known for share in coverage.within)
            correlation = f"{known[0].rank_correlation:.2f}"
            lines.append(f"| {one.hands.name} | {one.run.method.name} | {shares} | {correlation} |")
    return "\n".join(lines) if len(lines) > 2 else ""


def _share(share: Mean) -> str:
    """A percentage with its interval."""
    return f"{share.value:.0f} ({share.interval.low:.0f} … {share.interval.high:.0f})"
