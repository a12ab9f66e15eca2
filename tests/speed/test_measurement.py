"""Measurements: works in turn, quartiles, memory at its peak."""

import dataclasses
from functools import partial
from typing import Any

import numpy as np
import pytest

from hand_recon.speed.measurement import (
    WARM_UP,
    Settings,
    Work,
    interleaved,
    peak_memory,
    ratios,
    spread,
)
from hand_recon.speed.rows import LeftOut, Row, Spread, row_from

MEGABYTES = 96


def test_works_run_in_turn_and_the_first_runs_do_not_count() -> None:
    order: list[str] = []
    works: dict[str, Work] = {name: partial(order.append, name) for name in ("one", "other")}
    times = interleaved(works, Settings(seconds=0.0))
    assert order == ["one", "other"] * (len(order) // 2)
    assert len(times["one"]) == len(times["other"]) == len(order) // 2 - WARM_UP
    assert len(times["one"]) >= 5


def test_a_heavier_work_takes_longer() -> None:
    rows = np.random.default_rng(0).normal(size=200_000)
    works = {"sort": lambda: np.sort(rows), "nothing": lambda: None}
    times = interleaved(works, Settings(seconds=0.2))
    assert ratios(times["sort"], times["nothing"]).low > 10


def test_quartiles_by_hand() -> None:
    assert spread([4.0, 1.0, 3.0, 2.0, 5.0]) == Spread(3.0, 2.0, 4.0)
    assert spread([7.0]) == Spread(7.0, 7.0, 7.0)
    # Pairs, not medians: 2/1, 9/3, 8/2.
    assert ratios([2.0, 9.0, 8.0], [1.0, 3.0, 2.0]) == Spread(3.0, 2.5, 3.5)


@pytest.mark.parametrize(
    ("settings", "processor"),
    [
        (Settings(threads=1, device="cpu"), True),
        (Settings(threads=2, device="cpu"), False),
        (Settings(threads=1, device="cuda"), False),
    ],
)
def test_processor_time_is_for_one_thread_of_a_processor(
    settings: Settings, processor: bool
) -> None:
    assert settings.processor_time is processor


def holding(megabytes: int) -> Work:
    """Make a work that fills so much memory for a moment."""
    return lambda: float(np.ones(megabytes * 131_072).sum())


def test_memory_is_the_growth_at_the_peak() -> None:
    grown = peak_memory(partial(holding, MEGABYTES), 1)
    # Pages of the heap that were free before are not counted.
    assert MEGABYTES - 1 < grown < MEGABYTES + 32


def failing() -> Work:
    """Make no work."""
    raise SystemExit(3)


def test_a_process_that_ends_early_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="ended with status"):
        peak_memory(failing, 1)


def row(ratio: float | None, **values: Any) -> Row:  # noqa: ANN401  # any field
    """A row with a ratio and no spread."""
    given = None if ratio is None else Spread(ratio, ratio, ratio)
    base = Row(suite="layer", work="w", size="2 hands", seconds=Spread(2, 1, 3), ratio=given)
    return dataclasses.replace(base, **values)


@pytest.mark.parametrize(
    ("values", "met"),
    [
        ({"wanted_ratio": 3.0, "ratio": 3.0}, True),
        ({"wanted_ratio": 3.0, "ratio": 2.9}, False),
        ({"wanted_seconds": 2.0, "ratio": None}, True),
        ({"wanted_seconds": 1.9, "ratio": None}, False),
        ({"ratio": 5.0}, None),
    ],
)
def test_what_is_wanted(values: dict[str, Any], met: bool | None) -> None:
    ratio = values.pop("ratio")
    assert row(ratio, **values).met is met


def test_rows_pass_through_their_records() -> None:
    for one in (row(2.0, reference="r", reference_seconds=Spread(4, 4, 4), note="n"), row(None)):
        assert row_from(dataclasses.asdict(one)) == one
    assert LeftOut("a", "b", "c") == LeftOut(**dataclasses.asdict(LeftOut("a", "b", "c")))
