"""Distances and the area under their PCK curve, exactly as in the protocol."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.evaluation.point_error import auc, point_errors
from hand_recon.speed.published import scores_by_definition
from tests.support.tolerance import BATCH_SHAPES


def test_the_distance_of_a_three_four_five_triangle_is_five() -> None:
    prediction = torch.tensor([[0.003, 0.004, 0.0]])
    torch.testing.assert_close(
        point_errors(torch.zeros(1, 3), prediction), torch.tensor([0.005]).double()
    )


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (0.0, 1.0),
        (1e-15, 98.5 / 99),  # The first step of the curve is half a trapezoid.
        (0.01, 0.8030303030303030),  # 79.5 of 99: a hundred thresholds, not a continuum.
        (0.05, 0.5 / 99),  # An error equal to a threshold is within it.
        (0.0500001, 0.0),
        (float("inf"), 0.0),
    ],
)
def test_a_constant_error_has_a_known_area(error: float, expected: float) -> None:
    area = auc(torch.full((21,), error, dtype=torch.float64))
    assert float(area) == pytest.approx(expected, abs=1e-12)


def test_an_error_equal_to_a_threshold_is_within_it() -> None:
    thresholds = np.linspace(0.0, 0.05, 100)
    areas = auc(torch.from_numpy(thresholds)[:, None])
    expected = torch.tensor([1.0, *((99.5 - k) / 99 for k in range(1, 100))], dtype=torch.float64)
    torch.testing.assert_close(areas, expected)


@given(
    seed=st.integers(0, 2**31),
    frames=st.integers(1, 5),
    points=st.integers(1, 8),
    scale=st.floats(1e-4, 0.1),
)
def test_the_mean_over_hands_is_the_curve_over_frames(
    seed: int, frames: int, points: int, scale: float
) -> None:
    errors = scale * np.random.default_rng(seed).exponential(size=(frames, points))
    area = float(auc(torch.from_numpy(errors)).mean())
    assert area == pytest.approx(scores_by_definition.auc(errors), abs=1e-12)


def test_errors_are_in_the_unit_of_the_limit() -> None:
    errors = torch.rand(5, 21, dtype=torch.float64) * 0.06
    torch.testing.assert_close(auc(errors * 1000, limit=50.0), auc(errors))


@pytest.mark.parametrize("batch", BATCH_SHAPES)
def test_any_batch_shape_gives_one_area_per_hand(batch: tuple[int, ...]) -> None:
    assert auc(torch.rand(*batch, 21)).shape == batch
