"""Times of frames increase, and are those of the container wherever it has them."""

import itertools
import math

from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.video.times import Clock


def converted(raw: list[float], step: float = 0.1) -> list[float]:
    clock = Clock(step)
    return [round(clock.time(value), 9) for value in raw]


def test_increasing_times_are_kept_relative_to_the_first() -> None:
    assert converted([5.0, 5.25, 5.3, 9.0]) == [0.0, 0.25, 0.3, 4.0]


def test_missing_times_are_one_step_apart_and_do_not_shift_later_ones() -> None:
    """OpenCV gives 0 for a missing time; in a file of the kind that leaves out every second one, too."""
    assert converted([0.0, 0.0, 0.0]) == [0.0, 0.1, 0.2]
    assert converted([0.0, 0.0, 0.2, math.nan, 0.4, math.inf]) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]


def test_after_a_jump_back_frames_keep_their_distances() -> None:
    assert converted([1.0, 2.0, 1.5, 1.75, 3.0]) == [0.0, 1.0, 1.1, 1.35, 2.6]
    assert converted([1.0, 2.0, 2.0, 2.5]) == [0.0, 1.0, 1.1, 1.6]


def test_a_first_time_before_zero_counts_as_zero() -> None:
    """OpenCV gives the decoding time of a first frame with the time 0, two frames early with B-frames."""
    assert converted([-0.08, 0.04, 0.08]) == [0.0, 0.04, 0.08]


@given(st.lists(st.floats(min_value=-10, max_value=1e6) | st.just(math.nan), min_size=1))
def test_times_increase_whatever_comes(raw: list[float]) -> None:
    clock = Clock(1 / 30)
    times = [clock.time(value) for value in raw]
    assert times[0] == 0
    assert all(math.isfinite(time) for time in times)
    assert all(later > earlier for earlier, later in itertools.pairwise(times))


@given(st.lists(st.integers(min_value=1, max_value=10**9), min_size=1, unique=True))
def test_increasing_times_need_no_repair(milliseconds: list[int]) -> None:
    clock = Clock(1 / 30)
    raw = [value / 1000 for value in sorted(milliseconds)]
    times = [clock.time(value) for value in raw]
    assert clock.repaired == 0
    assert times == [value - raw[0] for value in raw]
