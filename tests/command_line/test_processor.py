import gc
import os
import time

import pytest

from hand_recon.command_line.processor import (
    BusyTime,
    busy_time,
    collection_paused,
    default_threads,
    free_cores,
)


def at(wall: float, machine: float, own: float, cores: int = 2) -> BusyTime:
    return BusyTime(wall, machine, own, cores)


@pytest.mark.parametrize(
    ("usable", "machine", "own", "cores", "expected"),
    [
        (2, 5.0, 5.0, 2, 2),  # Only this process is busy.
        (2, 10.0, 5.0, 2, 1),  # One of two cores is another's.
        (2, 10.0, 0.0, 2, 1),  # Both are, and one thread is the least.
        (8, 20.0, 0.0, 8, 4),  # 4 of 8 cores over 5 seconds.
        (2, 160.0, 0.0, 64, 1),  # Half of a host of 64 cores, of which this process may use two.
        (4, 1.0, 3.0, 4, 4),  # Counters that lag behind each other.
    ],
)
def test_cores_that_others_keep_busy_are_not_taken(
    usable: int, machine: float, own: float, cores: int, expected: int
) -> None:
    before, now = at(100.0, 50.0, 1.0, cores), at(105.0, 50.0 + machine, 1.0 + own, cores)
    assert free_cores(usable, before, now) == expected


def test_without_counters_or_time_between_them_all_usable_cores_are_taken() -> None:
    assert free_cores(6, None, at(1.0, 1.0, 1.0)) == 6
    assert free_cores(6, at(1.0, 0.0, 0.0), None) == 6
    assert free_cores(6, at(1.0, 0.0, 0.0), at(1.5, 9.0, 0.0)) == 6


@pytest.mark.skipif(not os.path.exists("/proc/stat"), reason="needs /proc/stat")
def test_counters_count_this_process_among_the_machine() -> None:
    before = busy_time()
    assert before is not None
    assert before.cores == os.cpu_count()
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass
    now = busy_time()
    assert now is not None
    assert now.own - before.own >= 0.25
    # The machine's counters are ticks of 10 ms per core.
    assert now.machine - before.machine >= 0.2
    assert 1 <= default_threads() <= len(os.sched_getaffinity(0))


def test_the_search_for_unreachable_objects_is_paused_and_goes_on_as_before() -> None:
    assert gc.isenabled()
    with collection_paused():
        assert not gc.isenabled()
    assert gc.isenabled()
    gc.disable()
    try:
        with collection_paused():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
