"""Table 1 as text for terminal, Markdown and HTML, and as unrounded numbers for CSV (Sec. 4.2)."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from hand_recon.tables.intervals import Interval
from hand_recon.tables.paper import COMPARED, CONDITIONS, KNOWLEDGE
from hand_recon.tables.studies import Study
from hand_recon.tables.summary import BOOTSTRAPPED, Change, Row, Spread, Summary
from hand_recon.visualization.score_names import heading

ABSENT: Final = "–"
"""Cell of a value that was not run or not measured."""

UNITS: Final = {"E_J": "mm", "E_V": "mm", "PR": "%"}
"""Units of the scores in the paper's Table 1."""

FURTHER: Final = {
    "ROM": ("hands far outside ranges, %", 1),
    "ROM_degrees": ("largest violation, °", 2),
    "E_2D": ("E_2D, px", 2),
    "sigma_median": ("median σ, px", 2),
    "coverage_1sigma": ("within 1σ", 3),
    "coverage_2sigma": ("within 2σ", 3),
    "ECE": ("gap of coverages", 3),
    "rank_sigma_noise": ("σ ranks label noise", 2),
    "rank_sigma_error": ("σ ranks error", 2),
}
"""Scores that the paper's table does not have: heading and decimal places."""

OF_SIGMA: Final = ("ECE", *(name for name in FURTHER if "sigma" in name))
"""Scores that have a meaning only where σ was learnt."""


@dataclass(frozen=True)
class TextTable:
    """A table of strings."""

    title: str
    """Title above the table."""
    columns: tuple[str, ...]
    """Headings; the first column names the rows."""
    rows: tuple[tuple[str, ...], ...]
    """Cells."""


def text_tables(summary: Summary) -> tuple[TextTable, ...]:
    """Tables of one study; empty tables are left out."""
    tables = (_table_1(summary), _further(summary), _intervals(summary))
    return tuple(table for table in tables if table.rows and len(table.columns) > 1)


def describe(study: Study) -> str:
    """Model, data and budget of a study in one line, as far as its settings are known."""
    settings = study.settings
    encoder = settings.get("model.encoder.backbone") or settings.get("model.encoder._target_", "")
    parts = [
        " ".join(filter(None, [settings.get("data", "unknown data"), settings.get("data.level")])),
        _worded(settings.get("data.train_size"), "{} training hands"),
        _worded(settings.get("test_hands"), "{} test hands"),
        _worded(settings.get("hand._target_", "").rpartition(".")[-1].replace("_", " "), "{}"),
        encoder.rpartition(".")[-1],
        _worded(settings.get("crop_size"), "{} px"),
        _worded(settings.get("trainer.max_epochs"), "{} epochs"),
        _worded(settings.get("data.batch_size"), "batches of {}"),
    ]
    return ", ".join(part for part in parts if part)


def notes(summary: Summary) -> list[str]:
    """Notes to show below the tables."""
    study = summary.study
    sentences = []
    if _has_table_1(summary):
        sentences.append(
            f"The paper's numbers are on {CONDITIONS}; ours are on {describe(study)}. "
            "Compare the steps from row to row, not the values."
        )
    sentences.append(
        "± is the standard deviation over seeds. A change is ours, from the row above. The mean pose is one "
        "constant hand for every image."
    )
    if summary.ratios:
        sentences.append(f"E_J falls {'; '.join(_ratio_texts(summary))}.")
    if "E_J" in summary.mean_pose:
        floor = summary.mean_pose["E_J"].mean
        behind = [
            row.label
            for row in (*summary.table, *summary.others)
            if "E_J" in row.scores and row.scores["E_J"].mean >= floor
        ]
        if behind:
            sentences.append(f"Not better than the mean pose in E_J: {', '.join(behind)}.")
    counts = {len(row.seeds) for row in summary.table if row.seeds}
    if len(counts) > 1:
        sentences.append("The rows have different numbers of seeds.")
    sentences += [
        f"Row {row.paper.number} was run with other knowledge than the paper's row."
        for row in summary.table
        if row.paper is not None and row.seeds and row.knowledge != row.paper.knowledge
    ]
    if study.differs:
        settings = ", ".join(f"{name}={value}" for name, value in study.differs.items())
        sentences.append(f"Other studies of this report differ in these settings: {settings}.")
    return sentences


def csv_rows(summaries: Iterable[Summary]) -> list[dict[str, str | float | int | None]]:
    """CSV lines, one per study and row, with unrounded numbers; every line has the same columns."""
    lines = []
    for number, summary in enumerate(summaries, start=1):
        for row in (*summary.table, *summary.others, _mean_pose_row(summary)):
            line: dict[str, str | float | int | None] = {"study": number, "row": row.label}
            line |= dict(zip(KNOWLEDGE, row.knowledge or [None] * len(KNOWLEDGE), strict=True))
            for name in COMPARED:
                line[f"{name}_paper"] = row.paper.scores[name] if row.paper else None
                line |= _raw(name, row)
            for name in FURTHER:
                line |= _raw_spread(name, row)
            line["seeds"] = " ".join(str(seed) for seed in row.seeds)
            line["about"] = describe(summary.study)
            lines.append(line)
    return lines


def _table_1(summary: Summary) -> TextTable:
    columns = ["row", *KNOWLEDGE]
    for name in COMPARED:
        columns += [f"{heading(name, UNITS[name])}: paper", f"{name} ours, {UNITS[name]}", "change"]
    # Where no row was run, the paper's five rows would be shown beside unrelated runs.
    table = summary.table if _has_table_1(summary) else ()
    rows = [
        (
            row.label,
            *_marks(row),
            *(cell for name in COMPARED for cell in _compared_cells(name, row)),
            str(len(row.seeds)) if row.seeds else ABSENT,
        )
        for row in (*table, *summary.others)
    ]
    if summary.mean_pose:
        row = _mean_pose_row(summary)
        cells = [cell for name in COMPARED for cell in _compared_cells(name, row)]
        rows.append((row.label, *[""] * len(KNOWLEDGE), *cells, ""))
    title = "Table 1" if table else "Experiments that Table 1 does not have"
    return TextTable(title, (*columns, "seeds"), tuple(rows))


def _has_table_1(summary: Summary) -> bool:
    return any(row.seeds for row in summary.table)


def _further(summary: Summary) -> TextTable:
    run = {row.label: _meaningful(row) for row in (*summary.table, *summary.others) if row.seeds}
    names = [name for name in FURTHER if any(name in scores for scores in run.values())]
    rows = [
        (label, *(spread_text(scores.get(name), FURTHER[name][1]) for name in names))
        for label, scores in run.items()
    ]
    columns = ("row", *(FURTHER[name][0] for name in names))
    return TextTable("Scores that the paper's table does not have", columns, tuple(rows))


def _meaningful(row: Row) -> dict[str, Spread]:
    """Scores of a row, without those of σ where σ was not learnt."""
    untrained = row.knowledge is not None and not row.knowledge[-1]
    return {
        name: score for name, score in row.scores.items() if not (untrained and name in OF_SIGMA)
    }


def _intervals(summary: Summary) -> TextTable:
    rows = [row for row in (*summary.table, *summary.others) if row.intervals]
    columns = ["row"]
    for name in BOOTSTRAPPED:
        columns += [heading(name, "mm"), "change from the row above"]
    return TextTable(
        "95 % bootstrap intervals over the test hands (means over seeds per hand; changes paired)",
        tuple(columns),
        tuple(
            (
                row.label,
                *(
                    interval_text(found.get(name))
                    for name in BOOTSTRAPPED
                    for found in (row.intervals, row.change_intervals)
                ),
            )
            for row in rows
        ),
    )


def _mean_pose_row(summary: Summary) -> Row:
    return Row("mean pose", None, None, summary.mean_pose)


def _marks(row: Row) -> list[str]:
    if row.knowledge is None:
        return [ABSENT] * len(KNOWLEDGE)
    return ["✓" if known else "" for known in row.knowledge]


def _compared_cells(name: str, row: Row) -> tuple[str, str, str]:
    decimals = 1 if name == "PR" else 2
    return (
        f"{row.paper.scores[name]:.1f}" if row.paper else ABSENT,
        spread_text(row.scores.get(name), decimals),
        change_text(row.changes.get(name), decimals, points=name == "PR"),
    )


def spread_text(spread: Spread | None, decimals: int) -> str:
    """Format mean ± standard deviation.

    >>> spread_text(Spread(10.0, 0.5), 2), spread_text(Spread(10.0, None), 1), spread_text(None, 1)
    ('10.00 ± 0.50', '10.0', '–')
    """
    if spread is None:
        return ABSENT
    text = _number(spread.mean, decimals)
    return text if spread.sd is None else f"{text} ± {spread.sd:.{decimals}f}"


def change_text(change: Change | None, decimals: int, *, points: bool) -> str:
    """Format a signed change, with its percentage or, for percentages, in points.

    >>> change_text(Change(-5.0, -50.0), 2, points=False)
    '−5.00 (−50 %)'
    >>> change_text(Change(-9.5, -83.0), 1, points=True)
    '−9.5 points'
    """
    if change is None:
        return ABSENT
    text = _signed(change.absolute, decimals)
    if points:
        return f"{text} points"
    return text if change.percent is None else f"{text} ({_signed(change.percent, 0)} %)"


def interval_text(interval: Interval | None) -> str:
    """Format both ends of an interval.

    >>> interval_text(Interval(-1.25, 0.5))
    '−1.25 … 0.50'
    """
    if interval is None:
        return ABSENT
    return f"{_number(interval.low, 2)} … {_number(interval.high, 2)}"


def _ratio_texts(summary: Summary) -> list[str]:
    texts: list[str] = []
    for ratio in summary.ratios:
        first, later = ratio.rows
        text = (
            f"{ratio.ours:.2f} times from row {first} to row {later} (paper {ratio.paper:.2f}"
            if not texts
            else f"{ratio.ours:.2f} times to row {later} (paper {ratio.paper:.2f}"
        )
        within = f", 95 % interval {interval_text(ratio.interval)}" if ratio.interval else ""
        texts.append(f"{text}{within})")
    return texts


def _raw(name: str, row: Row) -> dict[str, str | float | int | None]:
    change, own = row.changes.get(name), row.intervals.get(name)
    paired = row.change_intervals.get(name)
    return _raw_spread(name, row) | {
        f"{name}_low": own.low if own else None,
        f"{name}_high": own.high if own else None,
        f"{name}_change": change.absolute if change else None,
        f"{name}_change_percent": change.percent if change else None,
        f"{name}_change_low": paired.low if paired else None,
        f"{name}_change_high": paired.high if paired else None,
    }


def _raw_spread(name: str, row: Row) -> dict[str, str | float | int | None]:
    spread = row.scores.get(name)
    return {
        f"{name}_mean": spread.mean if spread else None,
        f"{name}_sd": spread.sd if spread else None,
    }


def _worded(value: str | None, words: str) -> str:
    return words.format(value) if value else ""


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−")


def _signed(value: float, decimals: int) -> str:
    return f"{value:+.{decimals}f}".replace("-", "−")
