"""Results of a benchmark as JSON, Markdown and a plot, and beside those of an earlier one."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure

from hand_recon.reading.text import parse_json, read_text
from hand_recon.speed.rows import LeftOut, Row, Spread, row_from

FILES: Final = ("benchmark.json", "benchmark.md", "benchmark.png")
"""Files of a benchmark."""
FORMAT: Final = "hand_recon.benchmark/1"
CHANGE: Final = 0.25
"""Relative change of a ratio that is reported; quartiles of a busy machine are about as wide."""
HEADINGS: Final = (
    "work", "amount", "time", "reference", "its time", "times as fast", "wanted", "difference", "memory",
)  # fmt: skip


@dataclass(frozen=True)
class Benchmark:
    """All rows of a run of the benchmark."""

    machine: dict[str, str | int | float]
    """The machine (`machine.describe`)."""
    settings: dict[str, Any]
    """Settings of the run."""
    rows: list[Row] = field(default_factory=list)
    """Measured rows."""
    left_out: list[LeftOut] = field(default_factory=list)
    """Works that this machine could not measure."""


def write_benchmark(folder: Path, found: Benchmark, baseline: Benchmark | None = None) -> None:
    """Write the files of a benchmark.

    Args:
        folder: An existing folder.
        found: The benchmark.
        baseline: An earlier one to compare with.
    """
    content = {"format": FORMAT, **asdict(found)}
    (folder / FILES[0]).write_text(json.dumps(content, indent=1), encoding="utf-8")
    (folder / FILES[1]).write_text(markdown(found, baseline), encoding="utf-8")
    plot(found).savefig(folder / FILES[2], dpi=120)


def read_benchmark(path: Path) -> Benchmark:
    """Read `benchmark.json`.

    Args:
        path: The file, or its folder.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no benchmark of this format.
    """
    path = path / FILES[0] if path.is_dir() else path
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} does not exist; expected the benchmark.json of an earlier benchmark. Give its folder "
            "or the file as baseline=<path>."
        )
    try:
        content = parse_json(read_text(path), path)
        if content["format"] != FORMAT:
            raise ValueError(content["format"])
        rows = [row_from(row) for row in content["rows"]]
        left_out = [LeftOut(**one) for one in content["left_out"]]
        return Benchmark(content["machine"], content["settings"], rows, left_out)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path} is not a benchmark of the format {FORMAT} ({error}). Run it again."
        ) from error


def markdown(found: Benchmark, baseline: Benchmark | None = None) -> str:
    """The results as a document: the machine, a table per suite, what was left out, what changed.

    Args:
        found: The benchmark.
        baseline: An earlier one to compare with.
    """
    lines = ["# Benchmark", ""]
    lines += [", ".join(f"{key}: {value}" for key, value in found.machine.items()), ""]
    lines += [
        "Settings: " + ", ".join(f"{key}={value}" for key, value in found.settings.items()),
        "",
    ]
    lines += ["Median (first to third quartile) of runs in turn in one process.", ""]
    for suite in dict.fromkeys(row.suite for row in found.rows):
        lines += [f"## {suite}", "", *_table(HEADINGS, cells(found, suite)), ""]
        notes = [
            f"* {row.work}, {row.size}: {row.note}"
            for row in found.rows
            if row.suite == suite and row.note
        ]
        lines += [*notes, ""] if notes else []
    if found.left_out:
        lines += ["## Left out", ""]
        lines += [f"* {one.suite}, {one.work}: {one.reason}" for one in found.left_out] + [""]
    if baseline is not None:
        lines += ["## Beside the baseline", "", *_changes(found, baseline), ""]
    return "\n".join(lines)


def cells(found: Benchmark, suite: str) -> list[tuple[str, ...]]:
    """Cells of the table of one suite, in the order of `HEADINGS`."""
    return [
        (
            row.work,
            row.size,
            duration(row.seconds),
            row.reference or "",
            "" if row.reference_seconds is None else duration(row.reference_seconds),
            "" if row.ratio is None else _number(row.ratio),
            _wanted(row),
            row.difference,
            _memory(row),
        )
        for row in found.rows
        if row.suite == suite
    ]


def duration(time: Spread) -> str:
    """A time with its quartiles in a unit that suits it."""
    unit, factor = (
        ("s", 1.0) if time.median >= 1 else ("ms", 1e3) if time.median >= 1e-3 else ("µs", 1e6)
    )
    low, middle, high = (f"{factor * part:.3g}" for part in (time.low, time.median, time.high))
    return f"{middle} {unit} ({low}–{high})"


def _number(ratio: Spread) -> str:
    low, middle, high = (
        f"{part:.3g}" if part < 1000 else f"{part:,.0f}"
        for part in (ratio.low, ratio.median, ratio.high)
    )
    return f"{middle} ({low}–{high})"


def _wanted(row: Row) -> str:
    if row.met is None:
        return ""
    least = (
        f"≥ {row.wanted_ratio:g}" if row.wanted_ratio is not None else f"≤ {row.wanted_seconds:g} s"
    )
    return f"{least}: {'met' if row.met else 'not met'}"


def _memory(row: Row) -> str:
    if row.megabytes is None:
        return ""
    beside = "" if row.reference_megabytes is None else f" / {row.reference_megabytes:.0f} MB"
    return f"{row.megabytes:.0f} MB{beside}"


def _changes(found: Benchmark, baseline: Benchmark) -> list[str]:
    """Lines on the ratios that are no longer what they were."""
    before = {(row.name, row.reference): row for row in baseline.rows}
    lines = []
    for row in found.rows:
        old = before.get((row.name, row.reference))
        if row.ratio is None or old is None or old.ratio is None:
            continue
        change = row.ratio.median / old.ratio.median - 1
        if abs(change) > CHANGE:
            word = "faster" if change > 0 else "slower"
            lines.append(
                f"* {word}: {row.name}: {old.ratio.median:.3g} → {row.ratio.median:.3g} times {row.reference}"
            )
    compared = sum((row.name, row.reference) in before for row in found.rows)
    return [
        f"{compared} rows compared, {len(lines)} changed by more than {CHANGE:.0%}.",
        "",
        *lines,
    ]


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(headings) + " |", "|" + " --- |" * len(headings)]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def plot(found: Benchmark) -> Figure:
    """Ratios as bars with their quartiles, and what was wanted."""
    rows = [row for row in found.rows if row.ratio is not None][::-1]
    figure = Figure(figsize=(10, 1.2 + 0.32 * max(1, len(rows))), layout="constrained")
    axes = figure.subplots()
    for place, row in enumerate(rows):
        assert row.ratio is not None  # noqa: S101  # chosen above
        colour = {True: "#009e73", False: "#d55e00", None: "#999999"}[row.met]
        axes.barh(place, row.ratio.median, color=colour)
        axes.plot([row.ratio.low, row.ratio.high], [place, place], color="black", linewidth=1)
        if row.wanted_ratio is not None:
            axes.plot(
                [row.wanted_ratio] * 2, [place - 0.4, place + 0.4], color="black", linestyle=":"
            )
    axes.set_yticks(
        range(len(rows)),
        [f"{row.work}, {row.size}\nvs {row.reference}" for row in rows],
        fontsize=6,
    )
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.set_xscale("log")
    axes.axvline(1, color="black", linewidth=0.8)
    axes.set_xlabel("times as fast as the reference; black: quartiles; dotted: wanted")
    return figure
