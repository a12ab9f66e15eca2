"""F-score: the same counts as brute force."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from hand_recon.evaluation.f_score import BLOCK, F_THRESHOLDS, f_score
from tests.support import metric_reference as reference


def brute_force(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    return torch.tensor(
        [
            [reference.f_score(t, p, threshold) for threshold in F_THRESHOLDS]
            for t, p in zip(ground_truth.double().numpy(), prediction.double().numpy(), strict=True)
        ],
        dtype=torch.float64,
    )


def exactly(actual: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(actual, expected, rtol=0, atol=1e-14)


@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 2 * BLOCK + 3),
    other_count=st.integers(1, 2 * BLOCK + 3),
    noise=st.sampled_from([0.0, 0.001, 0.005, 0.02, 0.1]),
    offset=st.sampled_from([0.0, 0.004, 0.1, 0.6]),
)
def test_agrees_with_brute_force(
    seed: int, count: int, other_count: int, noise: float, offset: float
) -> None:
    random = np.random.default_rng(seed)
    size = random.uniform(0.002, 0.08, size=3)
    ground_truth = torch.from_numpy(random.normal(size=(2, count, 3)) * size)
    picked = ground_truth[:, random.integers(count, size=other_count)]
    prediction = picked + noise * torch.from_numpy(random.normal(size=picked.shape)) + offset
    exactly(f_score(ground_truth, prediction), brute_force(ground_truth, prediction))


def test_single_precision_points_get_double_precision_counts() -> None:
    ground_truth = torch.rand(3, 778, 3) * 0.1
    prediction = ground_truth + 0.01 * torch.randn(3, 778, 3)
    exactly(f_score(ground_truth, prediction), brute_force(ground_truth, prediction))


@pytest.mark.parametrize("threshold", F_THRESHOLDS)
def test_a_distance_equal_to_the_threshold_does_not_count(threshold: float) -> None:
    # From the origin, so that the translation is not rounded.
    ground_truth = torch.zeros(1, 1, 3, dtype=torch.float64)
    shift = torch.tensor([threshold, 0.0, 0.0], dtype=torch.float64)
    assert float(f_score(ground_truth, ground_truth + shift, (threshold,))) == 0.0
    nearer = shift * (1 - 1e-12)
    assert float(f_score(ground_truth, ground_truth + nearer, (threshold,))) == 1.0


def test_a_constant_shift_by_the_threshold_is_decided_in_double_precision() -> None:
    ground_truth = torch.rand(2, 400, 3, dtype=torch.float64) * 0.3
    prediction = ground_truth + torch.tensor([0.0, 0.005, 0.0], dtype=torch.float64)
    exactly(f_score(ground_truth, prediction), brute_force(ground_truth, prediction))


def test_half_the_points_each_way() -> None:
    # Of four predicted points two are right, and they cover one of two true ones: 2 · ½ · ½ / 1.
    ground_truth = torch.tensor([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    prediction = torch.tensor(
        [[[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.1, 0.0]]]
    )
    assert f_score(ground_truth, prediction).tolist() == [[0.5, 0.5]]


def test_surfaces_far_apart_score_zero() -> None:
    ground_truth = torch.rand(1, 778, 3) * 0.1
    assert f_score(ground_truth, ground_truth + 10).tolist() == [[0.0, 0.0]]


def test_it_is_symmetric_and_independent_of_the_order_of_points() -> None:
    ground_truth = torch.rand(2, 500, 3, dtype=torch.float64) * 0.1
    prediction = torch.rand(2, 600, 3, dtype=torch.float64) * 0.1
    scores = f_score(ground_truth, prediction)
    exactly(f_score(prediction, ground_truth), scores)
    exactly(
        f_score(ground_truth[:, torch.randperm(500)], prediction[:, torch.randperm(600)]), scores
    )


def test_a_collapsed_prediction_stays_finite() -> None:
    ground_truth = torch.rand(2, 778, 3) * 0.1
    assert f_score(ground_truth, torch.zeros(2, 778, 3)).isfinite().all()
    assert f_score(torch.zeros(2, 778, 3), torch.zeros(2, 778, 3)).tolist() == [[1.0, 1.0]] * 2


def test_no_hands_give_no_scores() -> None:
    assert f_score(torch.zeros(0, 778, 3), torch.zeros(0, 778, 3)).shape == (0, 2)
