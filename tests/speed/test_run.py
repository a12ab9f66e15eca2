"""The command benchmark: what it accepts, writes and compares."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.patches import Rectangle

from hand_recon.runs.unfinished import free_folder
from hand_recon.speed.benchmark_files import (
    FILES,
    Benchmark,
    duration,
    markdown,
    plot,
    read_benchmark,
    write_benchmark,
)
from hand_recon.speed.machine import describe
from hand_recon.speed.rows import LeftOut, Row, Spread
from hand_recon.speed.run import benchmark, known_device, wanted_suites
from hand_recon.speed.suites import SUITES, scaling
from tests.support.configurations import settings


def row(times: float, **values: Any) -> Row:  # noqa: ANN401  # any field
    """A row of the suite layer."""
    base = Row(
        suite="layer",
        work="eager hand layer",
        size="64 hands",
        seconds=Spread(0.004, 0.003, 0.005),
        reference="published formulas",
        reference_seconds=Spread(0.02, 0.02, 0.02),
        ratio=Spread(times, times - 0.5, times + 0.5),
    )
    return dataclasses.replace(base, **values)


def result(*rows: Row) -> Benchmark:
    """A benchmark of such rows."""
    return Benchmark(
        {"cores": 2}, {"threads": 1}, list(rows), [LeftOut("layer", "smplx", "absent")]
    )


def test_a_benchmark_passes_through_its_files(tmp_path: Path) -> None:
    found = result(row(5.0, wanted_ratio=4.0, difference="1e-08 m"), row(2.0, ratio=None))
    write_benchmark(tmp_path, found)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    assert read_benchmark(tmp_path) == found
    assert read_benchmark(tmp_path / FILES[0]) == found
    text = (tmp_path / FILES[1]).read_text(encoding="utf-8")
    assert "| 5 (4.5–5.5) | ≥ 4: met | 1e-08 m |" in text
    assert "| 4 ms (3–5) |" in text
    assert "layer, smplx: absent" in text


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(2.0, "2 s (2–2)"), (0.0125, "12.5 ms (12.5–12.5)"), (3.2e-5, "32 µs (32–32)")],
)
def test_times_have_a_unit_that_suits_them(seconds: float, shown: str) -> None:
    assert duration(Spread(seconds, seconds, seconds)) == shown


def test_a_change_beside_the_baseline_is_named() -> None:
    before = result(row(4.0), row(4.0, size="1 hands"), row(9.0, size="7 hands"))
    now = result(row(2.0), row(4.9, size="1 hands"), row(3.0, size="8 hands"))
    text = markdown(now, before)
    assert "2 rows compared, 1 changed by more than 25%." in text
    assert "slower: layer: eager hand layer, 64 hands: 4 → 2 times published formulas" in text
    assert "Beside the baseline" not in markdown(now)


def test_the_plot_has_a_bar_per_ratio() -> None:
    axes = plot(result(row(5.0, wanted_ratio=4.0), row(2.0, ratio=None))).axes[0]
    widths = [bar.get_width() for bar in axes.patches if isinstance(bar, Rectangle)]
    assert widths == [5.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not a benchmark"),
        ('{"format": "other/1"}', "other/1"),
        (json.dumps({"format": "hand_recon.benchmark/1", "machine": {}}), "settings|rows"),
        (
            json.dumps({
                "format": "hand_recon.benchmark/1", "machine": {}, "settings": {}, "left_out": [],
                "rows": [{"suite": "layer"}],
            }),
            "not a benchmark",
        ),
    ],
)  # fmt: skip
def test_other_files_are_no_baseline(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "benchmark.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_benchmark(path)


def test_a_missing_baseline_names_the_option(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="baseline=<path>"):
        read_benchmark(tmp_path / "none")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("all", list(SUITES)),
        ("physics", ["physics"]),
        ("physics, layer", ["layer", "physics"]),
        (["step", "layer"], ["layer", "step"]),
    ],
)
def test_suites_run_in_their_order(given: object, expected: list[str]) -> None:
    assert wanted_suites(given) == expected


@pytest.mark.parametrize("given", ["layers", "", "layer,speed", []])
def test_an_unknown_suite_lists_the_known(given: object) -> None:
    with pytest.raises(ValueError, match="expected all, or one or more of layer, physics"):
        wanted_suites(given)


def test_an_unknown_device_is_refused() -> None:
    assert known_device("cpu") == "cpu"
    with pytest.raises(ValueError, match=r"device=warp.*Use device=cpu"):
        known_device("warp")


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    assert free_folder(tmp_path, FILES) == tmp_path
    (tmp_path / "benchmark.md").touch()
    with pytest.raises(FileExistsError, match="output=<folder>"):
        free_folder(tmp_path, FILES)


def test_the_machine_is_described() -> None:
    found = describe()
    assert int(found["cores"]) >= 1
    assert found["processor"]


def test_the_command_writes_what_it_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scaling, "BATCHES", (1, 2))
    words = ("suite=scaling", "quick=true", "seconds=0")
    config = settings(tmp_path / "cache", tmp_path / "out", *words, name="benchmark")
    found = benchmark(config)
    assert read_benchmark(tmp_path / "out") == found
    assert {one.suite for one in found.rows} == {"scaling"}
    with pytest.raises(FileExistsError):
        benchmark(config)
