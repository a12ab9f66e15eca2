"""Calibration of the predicted σ: coverage, rank correlation, reliability, sparsification (Sec. 3.3).

The paper shows ellipses and ranked images (Fig. 4); these metrics put them into numbers. Coverage measures
whether σ has the right scale, rank correlations whether it is large where the error or the label noise is.
"""

import math
from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.per_sample import PerSampleMetric

COVERAGE_LEVELS: Final = tuple(level / 20 for level in range(1, 20))
"""Nominal coverages at which reliability is measured: 5 % to 95 %."""


def spearman(first: Float[Tensor, " value"], second: Float[Tensor, " value"]) -> Float[Tensor, ""]:
    """Spearman's rank correlation, −1 to 1; equal values share the mean of their ranks.

    NaN where all values of one side are equal, or there are none.
    """
    ranks = torch.stack([_ranks(first.double()), _ranks(second.double())])
    centred = ranks - ranks.mean(dim=-1, keepdim=True)
    spread = centred.square().sum(dim=-1).prod().sqrt()
    return (centred[0] * centred[1]).sum() / spread


def _ranks(values: Float[Tensor, " value"]) -> Float[Tensor, " value"]:
    _, inverse, counts = values.unique(return_inverse=True, return_counts=True)
    last = counts.cumsum(dim=0).double()
    return (last - (counts - 1) / 2)[inverse]


def reliability_curve(
    standardised: Float[Tensor, " value"], levels: Float[Tensor, " level"]
) -> Float[Tensor, " level"]:
    """Observed coverage of a Gaussian's central intervals at given nominal coverages.

    Args:
        standardised: Errors divided by their predicted σ; at least one.
        levels: Nominal coverages, 0 to 1.

    Returns:
        Share of errors inside each interval, 0 to 1; equal to the level where σ is right.
    """
    halves = math.sqrt(2.0) * torch.erfinv(levels.double())
    ordered = standardised.double().abs().sort().values
    inside = torch.searchsorted(ordered, halves, right=True)
    return inside.double() / len(ordered)


def expected_calibration_error(standardised: Float[Tensor, " value"]) -> Float[Tensor, ""]:
    """Mean distance of the reliability curve from the diagonal over `COVERAGE_LEVELS`, 0 to 1."""
    levels = torch.tensor(COVERAGE_LEVELS, dtype=torch.float64)
    return (reliability_curve(standardised, levels) - levels).abs().mean()


def sparsification_error(
    error: Float[Tensor, " value"], sigma: Float[Tensor, " value"]
) -> Float[Tensor, ""]:
    """Area between the sparsification curves by σ and by the error itself (AUSE, Ilg et al. 2018).

    A curve is the mean error of the values that remain while the largest are discarded one by one,
    divided by the mean of all. Zero if σ orders the errors perfectly; equal σ share their mean error.

    Args:
        error: Absolute errors, any unit; not all zero.
        sigma: Predicted standard deviations.
    """
    error = error.double()
    _, inverse, counts = sigma.unique(return_inverse=True, return_counts=True)
    mean_of_equals = (
        torch.zeros(len(counts), dtype=torch.float64).index_add(0, inverse, error) / counts
    )
    by_sigma = mean_of_equals.repeat_interleave(counts)
    kept = torch.arange(1, len(error) + 1)
    curves = [values.cumsum(dim=0) / kept for values in (by_sigma, error.sort().values)]
    return (curves[0] - curves[1]).mean() / error.mean()


class Calibration(PerSampleMetric):
    """Calibration of the predicted σ against residuals and, where it is known, label noise.

    `coverage_1sigma` and `coverage_2sigma` are shares of labelled coordinates whose residual is
    within one and two σ: 0.683 and 0.954 for a Gaussian (0.757 and 0.941 for a Laplace distribution).
    `ECE` is the mean gap between nominal and observed coverage over all levels. The others are per
    labelled landmark, with the root mean square of its two coordinates' σ and the length of its residual:
    `rank_sigma_error` and `rank_sigma_noise` are Spearman's rank correlations, `AUSE` is the area between
    the sparsification curves. `sigma_median` is over coordinates, pixels of the 224 crop.

    Undefined scores are absent: all without labels, rank correlations where one side is constant,
    `rank_sigma_noise` where no label noise is known.
    """

    def __init__(self) -> None:
        """Create an empty metric."""
        super().__init__({"residual": 42, "log_sigma": 42, "label_noise": 21})

    def update(
        self,
        residual: Float[Tensor, "hand landmark=21 2"],
        log_sigma: Float[Tensor, "hand landmark=21 2"],
        labelled: Bool[Tensor, "hand landmark=21"],
        label_noise: Float[Tensor, "hand landmark=21"] | None,
        index: Int[Tensor, " hand"],
    ) -> None:
        """Add a batch.

        Args:
            residual: Projection minus label, pixels of the 224 crop; any value where unlabelled.
            log_sigma: Predicted natural logarithm of σ in these pixels.
            labelled: Landmarks that have a label.
            label_noise: Standard deviation of each label's noise, in these pixels; NaN where unknown.
            index: Position of each sample in its dataset: a repeated sample counts once.

        Raises:
            ValueError: A log σ, or the residual of a label, is not finite.
        """
        unlabelled = ~labelled[..., None]
        require_finite("log σ", log_sigma, index)
        require_finite("residuals", residual.masked_fill(unlabelled, 0.0), index)
        if label_noise is None:
            label_noise = torch.full_like(residual[..., 0], torch.nan)
        self.record(
            index,
            residual=residual.masked_fill(unlabelled, torch.nan).flatten(start_dim=1),
            log_sigma=log_sigma.flatten(start_dim=1),
            label_noise=label_noise,
        )

    def compute(self) -> dict[str, float]:
        """Every number that has a meaning, over distinct samples.

        Raises:
            ValueError: An index is not unique.
        """
        residual = self.distinct("residual").unflatten(-1, (21, 2))
        labelled = residual.isfinite().all(dim=-1)
        if not labelled.any():
            return {}
        sigma = self.distinct("log_sigma").exp().unflatten(-1, (21, 2))[labelled]
        residual, noise = residual[labelled], self.distinct("label_noise")[labelled]
        standardised = (residual / sigma).flatten()
        inside = [(standardised.abs() <= bound).double().mean() for bound in (1, 2)]
        of_landmark, error = sigma.square().mean(dim=-1).sqrt(), residual.norm(dim=-1)
        known = noise.isfinite()
        scores = {
            "coverage_1sigma": inside[0],
            "coverage_2sigma": inside[1],
            "ECE": expected_calibration_error(standardised),
            "rank_sigma_error": spearman(of_landmark, error),
            "rank_sigma_noise": spearman(of_landmark[known], noise[known]),
            "AUSE": sparsification_error(error, of_landmark),
            "sigma_median": sigma.median(),
        }
        return {name: float(value) for name, value in scores.items() if value.isfinite()}
