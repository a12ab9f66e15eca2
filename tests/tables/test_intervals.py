"""Bootstrap intervals: width as in theory, paired columns, repeatable draws."""

import numpy as np
import pytest

from hand_recon.tables.intervals import Bootstrap, Interval, interval


def test_the_interval_of_a_mean_is_two_standard_errors_to_either_side() -> None:
    """400 values of deviation 2: a standard error of 0.1, so 1.96 · 0.1 to either side."""
    values = np.random.default_rng(1).normal(10.0, 2.0, size=(400, 1))
    found = interval(Bootstrap(resamples=4000).means(values)[:, 0])
    error = values.std() / np.sqrt(400)
    assert found.low == pytest.approx(values.mean() - 1.96 * error, abs=0.15 * error)
    assert found.high == pytest.approx(values.mean() + 1.96 * error, abs=0.15 * error)


def test_ninety_five_of_a_hundred_intervals_contain_the_true_mean() -> None:
    generator = np.random.default_rng(2)
    held = 0
    for _ in range(200):
        values = generator.exponential(3.0, size=(80, 1))
        found = interval(Bootstrap(resamples=300).means(values)[:, 0])
        held += not found.excludes(3.0)
    assert 178 <= held <= 198


def test_columns_are_drawn_together() -> None:
    """Two columns that differ by 5 for every hand differ by 5 in every draw."""
    first = np.random.default_rng(3).normal(size=50)
    draws = Bootstrap(resamples=700).means(np.stack([first, first - 5.0], axis=1))
    assert draws.shape == (700, 2)
    np.testing.assert_allclose(draws[:, 0] - draws[:, 1], 5.0)
    assert np.ptp(draws[:, 0]) > 0.1


def test_the_same_seed_draws_the_same_and_another_does_not() -> None:
    values = np.arange(20.0)[:, None]
    draws = [Bootstrap(600, seed).means(values) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(draws[0], draws[1])
    assert (draws[0] != draws[2]).any()


def test_no_hand_is_refused() -> None:
    with pytest.raises(ValueError, match="no hand"):
        Bootstrap().means(np.empty((0, 1)))


def test_an_interval_excludes_what_lies_outside() -> None:
    assert Interval(-2.0, -1.0).excludes(0.0)
    assert not Interval(-2.0, 1.0).excludes(0.0)
