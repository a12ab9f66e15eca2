"""Calibration of 3D covariances: quantiles, Mahalanobis distances, coverage, ranks, sparsification."""

import numpy as np
import pytest
import scipy.stats
import torch
from torch import Tensor

from hand_recon.evaluation.calibration_3d import (
    Calibration3D,
    region_bound,
    sigma_of,
    squared_mahalanobis,
)
from hand_recon.uncertainty.covariance_correction import LEVELS
from tests.support.tolerance import assert_close

HANDS = 1000


def scores(error: Tensor, covariance: Tensor, known: Tensor | None = None) -> dict[str, float]:
    if known is None:
        known = torch.ones(error.shape[:2], dtype=torch.bool)
    metric = Calibration3D()
    metric.update(error, covariance, known, torch.arange(len(error)))
    return metric.compute()


def drawn(factor: float = 1.0) -> tuple[Tensor, Tensor]:
    """Errors from full covariances with σ of about 2 to 30 mm, and these covariances times `factor`."""
    size = 0.002 * 15 ** torch.rand(HANDS, 21, 1, 1, dtype=torch.float64)
    root = size * torch.randn(HANDS, 21, 3, 3, dtype=torch.float64)
    covariance = root @ root.mT + 1e-6 * torch.eye(3, dtype=torch.float64)
    shape = torch.linalg.cholesky(covariance)
    error = (shape @ torch.randn(HANDS, 21, 3, 1, dtype=torch.float64))[..., 0]
    return error.float(), (factor * covariance).float()


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("level", LEVELS)
def test_bounds_are_quantiles_of_chi_squared(level: float, axes: int) -> None:
    assert region_bound(level, axes) == pytest.approx(scipy.stats.chi2.ppf(level, axes))


def test_the_mahalanobis_distance_agrees_with_a_calculation_by_hand() -> None:
    """Σ = [[4, 2, 0], [2, 5, 0], [0, 0, 9]], Σ⁻¹ = [[5, −2, 0], [−2, 4, 0], [0, 0, 16/9]] / 16."""
    covariance = torch.tensor([[4.0, 2.0, 0.0], [2.0, 5.0, 0.0], [0.0, 0.0, 9.0]])
    error = torch.tensor([[2.0, 1.0, 3.0], [0.0, 0.0, 6.0]])
    found = squared_mahalanobis(error, covariance.expand(2, 3, 3))
    # (5·4 − 2·2·2 + 4·1) / 16 + 9 / 9 = 2, and 36 / 9 = 4.
    assert_close(found, torch.tensor([2.0, 4.0]))
    assert float(sigma_of(covariance)) == pytest.approx(6.0**0.5)


def test_errors_drawn_from_the_covariances_are_covered_as_often_as_said() -> None:
    found = scores(*drawn())
    # Four standard errors of a share of 21,000 are 0.014 at a half.
    for region in ("3d", "depth", "lateral"):
        for level in LEVELS:
            name = f"coverage_{region}_{100 * level:.0f}"
            assert found[name] == pytest.approx(level, abs=0.014), name
    assert found["rank_3d"] > 0.6


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_a_wrong_scale_shows_in_coverage_and_not_in_ranks(factor: float) -> None:
    """A covariance times f covers what χ² has below f times its quantile."""
    error, covariance = drawn()
    right, found = scores(error, covariance), scores(error, factor * covariance)
    for axes, region in ((3, "3d"), (1, "depth"), (1, "lateral")):
        for level in LEVELS:
            expected = scipy.stats.chi2.cdf(factor * scipy.stats.chi2.ppf(level, axes), axes)
            name = f"coverage_{region}_{100 * level:.0f}"
            assert found[name] == pytest.approx(expected, abs=0.014), name
    assert found["rank_3d"] == pytest.approx(right["rank_3d"], abs=1e-6)
    assert found["AUSE_3d"] == pytest.approx(right["AUSE_3d"], abs=1e-6)


def test_scores_agree_with_a_calculation_by_hand() -> None:
    """Three known landmarks with σ of 10 mm along every axis, the third of 40 mm in depth."""
    error = torch.full((1, 21, 3), torch.nan)
    error[0, 1] = torch.tensor([0.010, 0.0, 0.0])  # d² = 1: in the half (2.37).
    error[0, 2] = torch.tensor([0.0, 0.018, 0.0])  # d² = 3.24: in 80 % (4.64), not in the half.
    error[0, 3] = torch.tensor([0.0, 0.0, 0.120])  # d² = 9: outside of 95 % (7.81).
    covariance = 1e-4 * torch.eye(3).repeat(1, 21, 1, 1)
    covariance[0, 3, 2, 2] = 0.04**2
    covariance[0, 4] = torch.nan  # Not known: does not matter.
    found = scores(error, covariance, error.isfinite().all(dim=-1))
    assert [found[f"coverage_3d_{level}"] for level in (50, 80, 95)] == pytest.approx(
        [1 / 3, 2 / 3, 2 / 3]
    )
    # Depth: 0, 0 and 3 σ. Across: 1 σ and 1.8 σ of six values; intervals are 0.674, 1.282 and 1.960 σ.
    assert found["coverage_depth_95"] == pytest.approx(2 / 3)
    assert [found[f"coverage_lateral_{level}"] for level in (50, 80, 95)] == pytest.approx(
        [4 / 6, 5 / 6, 1.0]
    )
    assert found["sigma_3d_median"] == pytest.approx(10.0)
    assert found["error_3d"] == pytest.approx((10 + 18 + 120) / 3)
    # Ranks 1.5, 1.5, 3 against 1, 2, 3: correlation 1.5 / √(1.5 · 2).
    assert found["rank_3d"] == pytest.approx(1.5 / 3**0.5)
    # Curves by σ: 14, 14, 49.33; by the error: 10, 14, 49.33; both over the mean, 49.33.
    assert found["AUSE_3d"] == pytest.approx(4 / 3 / (148 / 3), rel=1e-5)


def test_agrees_with_a_slow_loop() -> None:
    error, covariance = drawn(1.7)
    error, covariance = error[:20], covariance[:20]
    inside = [
        float(e @ np.linalg.inv(c) @ e) <= scipy.stats.chi2.ppf(0.8, 3)
        for e, c in zip(
            error.double().flatten(0, 1).numpy(), covariance.double().flatten(0, 1).numpy(),
            strict=True,
        )
    ]  # fmt: skip
    assert scores(error, covariance)["coverage_3d_80"] == pytest.approx(np.mean(inside))


def test_batches_join_and_repeated_samples_count_once() -> None:
    error, covariance = drawn()
    known = torch.ones(HANDS, 21, dtype=torch.bool)
    metric = Calibration3D()
    for rows in (torch.arange(600), torch.arange(500, HANDS)):
        metric.update(error[rows], covariance[rows], known[rows], rows)
    assert metric.compute() == pytest.approx(scores(error, covariance))


def test_nothing_known_has_no_scores() -> None:
    error, covariance = drawn()
    assert scores(error, covariance, torch.zeros(HANDS, 21, dtype=torch.bool)) == {}


def test_a_covariance_that_is_not_finite_is_refused() -> None:
    error, covariance = drawn()
    covariance[3, 5] = torch.inf
    with pytest.raises(ValueError, match=r"predicted covariances of the samples 3 are not finite"):
        scores(error, covariance)
