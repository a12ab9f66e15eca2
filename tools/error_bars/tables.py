"""Tables of the calibration of error bars: coverage with intervals, ranks, sparsification."""

from collections.abc import Mapping, Sequence
from typing import Final

from jaxtyping import Float
from torch import Tensor

from depth.scores import grouped_mean
from error_bars.errors import MEASURED, Errors
from hand_recon.evaluation.calibration_3d import region_bound, squared_mahalanobis
from hand_recon.uncertainty.covariance_correction import LEVELS, CovarianceCorrection

COLUMNS: Final = (
    "set", "error bars", "within 50 %", "80 %", "95 %", "by factors", "depth", "across", "rank", "AUSE",
    "σ, mm",
)  # fmt: skip
"""Titles of the table's columns."""


def markdown(sets: Sequence[Errors], corrections: Mapping[str, CovarianceCorrection | None]) -> str:
    """Table of every correction on every set.

    Args:
        sets: Errors that no correction has seen, or some that it has.
        corrections: Corrections by name; None for Laplace's approximation as it is.
    """
    lines = [_line(COLUMNS), _line(["---"] * len(COLUMNS))]
    for errors in sets:
        lines += [_row(errors, name, one) for name, one in corrections.items()]
    return "\n".join(lines)


def _row(errors: Errors, name: str, correction: CovarianceCorrection | None) -> str:
    covariance = errors.covariance(correction)
    scores = errors.scores(covariance)
    shares = [_share(errors, covariance, level) for level in LEVELS]
    by_factors = "—"
    if correction is not None:
        regions = [_share(errors, correction.region(covariance, level), level) for level in LEVELS]
        by_factors = ", ".join(share.split(" ")[0] for share in regions)
    return _line(
        [
            f"{errors.name} ({len(errors)})",
            name,
            *shares,
            by_factors,
            *(
                ", ".join(f"{100 * scores[f'coverage_{axis}_{100 * level:.0f}']:.0f}" for level in LEVELS)
                for axis in ("depth", "lateral")
            ),
            f"{scores['rank_3d']:.2f}",
            f"{scores['AUSE_3d']:.3f}",
            f"{scores['sigma_3d_median']:.1f}",
        ]
    )  # fmt: skip


def _share(errors: Errors, covariance: Float[Tensor, "hand landmark=21 3 3"], level: float) -> str:
    """Percentage of the landmarks within the ellipsoids of a level, with its 95 % interval."""
    places = list(MEASURED)
    distance = squared_mahalanobis(errors.error[:, places], covariance[:, places])
    inside = (distance <= region_bound(level, 3)).double().mean(dim=1)
    mean = grouped_mean(100 * inside, errors.groups)
    return f"{mean.value:.0f} ({mean.interval.low:.0f} … {mean.interval.high:.0f})"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
