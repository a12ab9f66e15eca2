"""Jitter of points over time."""

import numpy as np
import pytest

from hand_recon.motion.jitter import (
    acceleration_error,
    accelerations,
    in_a_row,
    jitter_millimetres,
    jitter_pixels,
)

EVEN = np.arange(12) / 30
UNEVEN = np.cumsum([0.03, 0.04, 0.03, 0.035, 0.03, 0.04, 0.03])


@pytest.mark.parametrize("times", [EVEN, UNEVEN])
def test_constant_acceleration_is_found_exactly(times: np.ndarray) -> None:
    pull = np.array([3.0, 0.0, -4.0])
    points = 0.1 + times[:, None, None] + pull * times[:, None, None] ** 2 / 2
    expected = np.tile(pull, (len(times) - 2, 1))
    np.testing.assert_allclose(accelerations(points, times)[:, 0], expected, atol=1e-9)
    assert jitter_millimetres(points, times) == pytest.approx(5000.0)
    assert acceleration_error(points, 0 * points, times) == pytest.approx(5000.0)
    assert acceleration_error(points, points + 1.0, times) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("times", [EVEN, UNEVEN])
def test_steady_motion_has_no_jitter(times: np.ndarray) -> None:
    points = times[:, None, None] * np.array([[20.0, -30.0]])
    assert jitter_pixels(points, times) == pytest.approx(0.0, abs=1e-9)


def test_one_point_aside_by_hand() -> None:
    points = np.zeros((5, 1, 2))
    points[2, 0] = [3.0, 4.0]
    # Off by 2.5, 5 and 2.5 pixels.
    assert jitter_pixels(points, np.arange(5.0)) == pytest.approx(
        np.sqrt((2.5**2 + 25 + 2.5**2) / 3)
    )


def test_independent_noise_gives_root_three_sigma() -> None:
    noise = 2.0 * np.random.default_rng(0).normal(size=(400, 21, 2))
    assert jitter_pixels(noise, np.arange(400) / 30) == pytest.approx(2 * np.sqrt(3), rel=0.02)


def test_frames_beside_a_gap_are_left_out() -> None:
    times = np.array([0.0, 1, 2, 3, 9, 10, 11]) / 30
    assert in_a_row(times).tolist() == [True, True, False, False, True]
    points = np.zeros((7, 1, 3))
    points[4:] = 1.0
    assert jitter_millimetres(points, times) == 0.0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_less_than_three_frames_have_no_jitter(count: int) -> None:
    times = np.arange(count) / 30
    assert np.isnan(jitter_millimetres(np.zeros((count, 21, 3)), times))
    assert np.isnan(jitter_pixels(np.zeros((count, 21, 2)), times))
