"""Coverage, ranks, reliability and sparsification of the predicted σ."""

import math

import numpy as np
import pytest
import scipy.stats
import torch
from torch import Tensor

from hand_recon.evaluation.calibration import (
    COVERAGE_LEVELS,
    Calibration,
    expected_calibration_error,
    reliability_curve,
    sparsification_error,
    spearman,
)
from tests.support.tolerance import assert_close

HANDS = 500


def drawn(factor: float = 1.0) -> tuple[Tensor, Tensor, Tensor]:
    """Residuals for a σ of 1 to 20 px per landmark, the logarithm of `factor` times σ, and σ."""
    noise = torch.exp(torch.rand(HANDS, 21) * math.log(20))
    residual = noise[..., None] * torch.randn(HANDS, 21, 2)
    return residual, (factor * noise).log()[..., None].expand(HANDS, 21, 2), noise


def scores(
    residual: Tensor,
    log_sigma: Tensor,
    noise: Tensor | None = None,
    labelled: Tensor | None = None,
) -> dict[str, float]:
    if labelled is None:
        labelled = torch.ones(residual.shape[:2], dtype=torch.bool)
    metric = Calibration()
    metric.update(residual, log_sigma, labelled, noise, torch.arange(len(residual)))
    return metric.compute()


def test_residuals_from_the_predicted_sigma_cover_as_a_gaussian_does() -> None:
    residual, log_sigma, noise = drawn()
    found = scores(residual, log_sigma, noise)
    # Four standard errors of a share of 21,000: 0.013 at 0.683 and 0.006 at 0.954.
    assert found["coverage_1sigma"] == pytest.approx(0.6827, abs=0.013)
    assert found["coverage_2sigma"] == pytest.approx(0.9545, abs=0.006)
    assert found["ECE"] < 0.01
    assert found["rank_sigma_noise"] == pytest.approx(1.0)
    assert found["rank_sigma_error"] > 0.7
    assert found["sigma_median"] == pytest.approx(math.sqrt(20), rel=0.1)


@pytest.mark.parametrize(("factor", "one", "two"), [(0.5, 0.3829, 0.6827), (2.0, 0.9545, 0.9999)])
def test_a_wrong_scale_shows_in_coverage_and_not_in_ranks(
    factor: float, one: float, two: float
) -> None:
    """Half the σ is 1σ where ½σ should be: 2Φ(½) − 1 = 0.383 and 2Φ(1) − 1 = 0.683."""
    found = scores(*drawn(factor))
    assert found["coverage_1sigma"] == pytest.approx(one, abs=0.014)
    assert found["coverage_2sigma"] == pytest.approx(two, abs=0.014)
    assert found["rank_sigma_noise"] == pytest.approx(1.0)
    assert found["ECE"] > 0.1


def test_scores_agree_with_a_calculation_by_hand() -> None:
    """σ = (3, 4) at the wrist, whose RMS is √12.5; (1, 1) at landmark 1; the others unlabelled."""
    residual = torch.full((1, 21, 2), float("nan"))
    residual[0, 0] = torch.tensor([-3.0, 8.5])  # 1.0 σ and 2.125 σ.
    residual[0, 1] = torch.tensor([0.5, -1.5])  # 0.5 σ and 1.5 σ.
    sigma = torch.full((1, 21, 2), 1000.0)
    sigma[0, 0] = torch.tensor([3.0 + 1e-4, 4.0])
    sigma[0, 1] = torch.tensor([1.0, 1.0])
    noise = torch.full((1, 21), 2.0)
    noise[0, 0] = 3.0
    found = scores(residual, sigma.log(), noise, residual.isfinite().all(dim=-1))
    assert found["coverage_1sigma"] == pytest.approx(2 / 4)
    assert found["coverage_2sigma"] == pytest.approx(3 / 4)
    assert found["rank_sigma_noise"] == pytest.approx(1.0)
    assert found["rank_sigma_error"] == pytest.approx(1.0)
    assert found["AUSE"] == pytest.approx(0.0)
    # Four numbers: the second smallest.
    assert found["sigma_median"] == pytest.approx(1.0)


def test_an_unrelated_sigma_has_no_rank_correlation() -> None:
    residual, log_sigma, noise = drawn()
    unknowing = log_sigma[torch.randperm(HANDS)]
    found = scores(residual, unknowing, noise)
    # Four standard errors of a rank correlation of 10,500 independent pairs: 0.04.
    assert abs(found["rank_sigma_noise"]) < 0.04
    assert abs(found["rank_sigma_error"]) < 0.04


def test_what_is_unknown_or_constant_is_absent() -> None:
    residual, log_sigma, noise = drawn()
    assert "rank_sigma_noise" not in scores(residual, log_sigma)
    assert "rank_sigma_noise" not in scores(residual, log_sigma, torch.full_like(noise, 2.0))
    assert "rank_sigma_noise" not in scores(residual, log_sigma, torch.full_like(noise, torch.nan))
    constant = scores(residual, torch.ones_like(log_sigma), noise)
    assert set(constant) == {"coverage_1sigma", "coverage_2sigma", "ECE", "AUSE", "sigma_median"}
    assert scores(residual, log_sigma, noise, torch.zeros(HANDS, 21, dtype=torch.bool)) == {}


def test_noise_known_of_some_hands_only_is_ranked_among_them() -> None:
    residual, log_sigma, noise = drawn()
    noise[100:] = torch.nan
    assert scores(residual, log_sigma, noise)["rank_sigma_noise"] == pytest.approx(1.0)


def test_batches_of_any_size_agree_and_a_sample_that_comes_twice_counts_once() -> None:
    residual, log_sigma, noise = drawn()
    labelled = torch.rand(HANDS, 21) > 0.3
    whole, parts = Calibration(), Calibration()
    index = torch.arange(HANDS)
    whole.update(residual, log_sigma, labelled, noise, index)
    for part in (index[:1], index[1:200], index[150:]):
        parts.update(residual[part], log_sigma[part], labelled[part], noise[part], part)
    assert parts.compute() == whole.compute()


def test_predictions_that_are_not_finite_name_their_samples() -> None:
    residual, log_sigma, _ = drawn()
    broken = log_sigma.clone()
    broken[7, 3] = float("inf")
    with pytest.raises(ValueError, match="log σ of the samples 7 are not finite"):
        scores(residual, broken)
    residual[8, 3] = float("nan")
    with pytest.raises(ValueError, match="residuals of the samples 8 are not finite"):
        scores(residual, log_sigma)


@pytest.mark.parametrize("digits", [0, 1, 8])
def test_spearman_is_scipys_with_and_without_ties(digits: int) -> None:
    first = torch.randn(300, dtype=torch.float64)
    second = (first + torch.randn(300, dtype=torch.float64)).round(decimals=digits)
    expected = scipy.stats.spearmanr(first.numpy(), second.numpy()).statistic
    assert float(spearman(first, second)) == pytest.approx(expected, abs=1e-12)


def test_spearman_of_no_values_or_of_a_constant_is_nan() -> None:
    assert spearman(torch.zeros(5), torch.arange(5.0)).isnan()
    assert spearman(torch.zeros(0), torch.zeros(0)).isnan()


def test_reliability_counts_what_lies_within_a_gaussians_interval() -> None:
    """Half of a Gaussian lies within 0.6745 σ, 90 % within 1.6449 σ."""
    standardised = torch.tensor([0.1, -0.67, 0.68, -1.64, 1.65])
    levels = torch.tensor([0.5, 0.9], dtype=torch.float64)
    assert_close(reliability_curve(standardised, levels), torch.tensor([2 / 5, 4 / 5]))


def test_errors_at_a_gaussians_quantiles_are_perfectly_calibrated() -> None:
    levels = torch.tensor(COVERAGE_LEVELS)
    exact = scipy.stats.norm.ppf((np.arange(4000) + 0.5) / 4000)
    standardised = torch.from_numpy(exact)
    assert_close(reliability_curve(standardised, levels), levels)
    assert float(expected_calibration_error(standardised)) < 1e-6


def test_the_worst_calibration_is_half() -> None:
    """All errors outside all intervals, or inside: the mean of the levels is ½."""
    assert float(expected_calibration_error(torch.full((9,), 99.0))) == pytest.approx(0.5)
    assert float(expected_calibration_error(torch.zeros(9))) == pytest.approx(0.5)


def slow_sparsification_error(error: list[float], sigma: list[float]) -> float:
    """Discard the values one by one and compare the means of the remaining ones."""
    by_sigma = [e for _, e in sorted(zip(sigma, error, strict=True))]
    by_error = sorted(error)
    gaps = [
        np.mean(by_sigma[:kept]) - np.mean(by_error[:kept]) for kept in range(1, len(error) + 1)
    ]
    return float(np.mean(gaps) / np.mean(error))


def test_sparsification_agrees_with_discarding_one_by_one() -> None:
    sigma = torch.rand(60, dtype=torch.float64)
    error = sigma * torch.randn(60, dtype=torch.float64).abs()
    expected = slow_sparsification_error(error.tolist(), sigma.tolist())
    assert float(sparsification_error(error, sigma)) == pytest.approx(expected)
    assert 0 < expected < slow_sparsification_error(error.tolist(), (-sigma).tolist())


def test_sparsification_by_hand_and_among_equals() -> None:
    """Errors 1 and 3 in the wrong order: means 3, 2 against 1, 2; the gap 2 over 2 steps and mean 2."""
    error = torch.tensor([1.0, 3.0])
    assert float(sparsification_error(error, torch.tensor([2.0, 1.0]))) == pytest.approx(0.5)
    assert float(sparsification_error(error, torch.tensor([1.0, 2.0]))) == pytest.approx(0.0)
    # Among equal σ either order is as likely.
    assert float(sparsification_error(error, torch.tensor([1.0, 1.0]))) == pytest.approx(0.25)
