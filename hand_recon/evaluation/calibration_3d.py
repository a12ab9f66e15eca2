"""Calibration of the 3D covariances of landmarks: coverage, rank correlation, sparsification (Sec. 3.3).

A landmark whose error is drawn from its covariance has a squared Mahalanobis distance that follows χ² with
three degrees of freedom. The share of landmarks within a quantile of χ² is compared with its level.
"""

from typing import Final

import scipy.special
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.evaluation.calibration import sparsification_error, spearman
from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.per_sample import PerSampleMetric
from hand_recon.uncertainty.covariance_correction import LEVELS

DEPTH: Final = 2
"""Index of the axis along the viewing direction in the camera's frame."""

_LANDMARKS: Final = 21


def region_bound(level: float, axes: int) -> float:
    """Squared Mahalanobis distance within which a Gaussian has a share of its mass.

    Args:
        level: The share, 0 to 1.
        axes: Number of dimensions.
    """
    return 2 * float(scipy.special.gammaincinv(axes / 2, level))


def squared_mahalanobis(
    error: Float[Tensor, "*batch 3"], covariance: Float[Tensor, "*batch 3 3"]
) -> Float[Tensor, "*batch"]:
    """Squared length of an error in standard deviations of its covariance, eᵀ Σ⁻¹ e.

    Args:
        error: Predicted minus true position, any unit of length.
        covariance: Positive definite, that unit squared.
    """
    return (error * torch.linalg.solve(covariance, error[..., None])[..., 0]).sum(dim=-1)


def sigma_of(covariance: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch"]:
    """Root mean square of the standard deviations along three axes, √(trace / 3), in the unit of length."""
    return (covariance.diagonal(dim1=-2, dim2=-1).sum(dim=-1) / 3).sqrt()


class Calibration3D(PerSampleMetric):
    """Calibration of 3D covariances against errors from the hand's root.

    `coverage_3d_50`, `_80` and `_95` are the shares of landmarks within the ellipsoids of `LEVELS`;
    `coverage_depth_…` is the same of the viewing direction alone, `coverage_lateral_…` of the two coordinates
    across it, each as an interval. `rank_3d` is Spearman's correlation of √(trace / 3) with the length of the
    error and `AUSE_3d` the area between the sparsification curves by the two. `sigma_3d_median` is the median
    of √(trace / 3), and `error_3d` the mean length of the errors, millimetres.

    Empty without a known landmark; `rank_3d` is absent where one side is constant.
    """

    def __init__(self) -> None:
        """Create an empty metric."""
        super().__init__({"error": 3 * _LANDMARKS, "covariance": 9 * _LANDMARKS})

    def update(
        self,
        error: Float[Tensor, "hand landmark=21 3"],
        covariance: Float[Tensor, "hand landmark=21 3 3"],
        known: Bool[Tensor, "hand landmark=21"],
        index: Int[Tensor, " hand"],
    ) -> None:
        """Add a batch.

        Args:
            error: Predicted minus true position from the root, axes of the camera, metres; any value where it
                is not known.
            covariance: Covariance of each predicted position, square metres.
            known: Landmarks with ground truth. Leave out the root, which has no error.
            index: Position of each sample in its dataset: a repeated sample counts once.

        Raises:
            ValueError: The covariance or the error of a known landmark is not finite.
        """
        unknown = ~known
        covariance = covariance.masked_fill(unknown[..., None, None], 0.0)
        require_finite("covariances", covariance, index)
        require_finite("3D errors", error.masked_fill(unknown[..., None], 0.0), index)
        # Millimetres, whose squares are far from the smallest numbers of single precision.
        self.record(
            index,
            error=1e3 * error.masked_fill(unknown[..., None], torch.nan).flatten(start_dim=1),
            covariance=1e6 * covariance.flatten(start_dim=1),
        )

    def compute(self) -> dict[str, float]:
        """Every number that has a meaning, over distinct samples.

        Raises:
            ValueError: An index is not unique.
        """
        error = self.distinct("error").unflatten(-1, (_LANDMARKS, 3))
        known = error.isfinite().all(dim=-1)
        if not known.any():
            return {}
        covariance = self.distinct("covariance").unflatten(-1, (_LANDMARKS, 3, 3))[known]
        error = error[known]
        sigma, length = sigma_of(covariance), error.norm(dim=-1)
        scores = {
            **coverages(error, covariance),
            "rank_3d": float(spearman(sigma, length)),
            "AUSE_3d": float(sparsification_error(length, sigma)),
            "sigma_3d_median": float(sigma.median()),
            "error_3d": float(length.mean()),
        }
        return {name: value for name, value in scores.items() if value == value}


def coverages(
    error: Float[Tensor, "value 3"], covariance: Float[Tensor, "value 3 3"]
) -> dict[str, float]:
    """Shares of errors within the regions of `LEVELS`, by name, as `Calibration3D` gives them.

    Args:
        error: Errors in the camera's axes, any unit of length.
        covariance: Their covariances, that unit squared.
    """
    squared = error.square() / covariance.diagonal(dim1=-2, dim2=-1)
    distances = {
        "3d": (squared_mahalanobis(error, covariance), 3),
        "depth": (squared[:, DEPTH], 1),
        "lateral": (squared[:, :DEPTH], 1),
    }
    return {
        f"coverage_{name}_{100 * level:.0f}": float(
            (distance <= region_bound(level, axes)).double().mean()
        )
        for name, (distance, axes) in distances.items()
        for level in LEVELS
    }
