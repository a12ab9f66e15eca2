"""Tables 2 and 3 with our runs below the rows they reproduce, and how their settings differ (Sec. 4.3, 5)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from hand_recon.tables.conditions import (
    differences,
    is_adversarial,
    is_full_knowledge,
    share_of_3d,
)
from hand_recon.tables.published import (
    ONLY_2D,
    TABLE_3A,
    TABLE_3B,
    TABLES_2,
    PublishedRow,
    PublishedTable,
)
from hand_recon.tables.studies import Experiment, Study
from hand_recon.tables.summary import Spread, spreads
from hand_recon.tables.text_tables import ABSENT, UNITS, TextTable, spread_text
from hand_recon.visualization.score_names import heading

UNITS_2_3: Final = {**UNITS, "E_RV": "mm"}
"""Units of the scores; areas under a curve have none."""


@dataclass(frozen=True)
class Entry:
    """One row of a table, the paper's or ours."""

    label: str
    """Name of the method."""
    learns_from: str
    """Labels that the method was trained with."""
    scores: dict[str, Spread]
    """Scores by name."""
    seeds: tuple[int, ...] = ()
    """Seeds that were averaged over; empty for the paper's rows."""
    differs: tuple[str, ...] = ()
    """Differences from the paper's settings, in words; empty for the paper's rows."""


@dataclass(frozen=True)
class Beside:
    """A table of the paper with our rows added."""

    table: PublishedTable
    """Table of the paper."""
    entries: tuple[Entry, ...]
    """Every published row, each followed by ours."""


@dataclass(frozen=True)
class _Ours:
    """One of our methods in one study."""

    study: Study
    experiment: Experiment

    @property
    def settings(self) -> dict[str, str]:
        return self.study.settings | self.experiment.method

    @property
    def data(self) -> str | None:
        return self.study.settings.get("data")


def beside(studies: Sequence[Study]) -> tuple[Beside, ...]:
    """Tables 2 and 3 as far as we have runs for them.

    Args:
        studies: Our runs.
    """
    ours = [_Ours(study, experiment) for study in studies for experiment in study.experiments]
    found = []
    for table in (*TABLES_2, TABLE_3A, TABLE_3B):
        repeated = [(one, row) for one in ours if (row := _row_of(table, one)) is not None]
        if repeated:
            found.append(Beside(table, tuple(_entries(table, repeated))))
    return tuple(found)


def text_table(one: Beside) -> TextTable:
    """Format a table as text, with the seeds and differences of our rows."""
    names = one.table.scores
    headings = [heading(name, UNITS_2_3.get(name)) for name in names]
    return TextTable(
        one.table.title,
        ("method", "learns from", *headings, "seeds", "differences from the paper"),
        tuple(
            (
                entry.label,
                entry.learns_from,
                *(
                    spread_text(entry.scores.get(name), _decimals(one.table, name, entry))
                    for name in names
                ),
                str(len(entry.seeds)) if entry.seeds else ABSENT,
                ("; ".join(entry.differs) or "none") if entry.seeds else "",
            )
            for entry in one.entries
        ),
    )


def notes_beside(one: Beside) -> list[str]:
    """Notes to show below the table."""
    sentences = [
        "Rows without seeds are the paper's numbers. The last column lists the settings in which a row of "
        "ours differs from the paper's; docs/decisions has the differences that all our runs share."
    ]
    if one.table is TABLE_3B:
        sentences.append(
            "The paper does not say which prior the fully supervised row has; we take the shape term alone."
        )
    if one.table.dataset == "ho3d":
        sentences.append("The paper's HO3D numbers are from the benchmark's server.")
    return sentences


def csv_rows_beside(tables: Sequence[Beside]) -> list[dict[str, str | float | None]]:
    """CSV lines, one per row, with unrounded numbers; every line has the same columns."""
    names = list(dict.fromkeys(name for one in tables for name in one.table.scores))
    lines = []
    for one in tables:
        for entry in one.entries:
            line: dict[str, str | float | None] = {
                "table": one.table.key, "method": entry.label, "learns_from": entry.learns_from,
                "source": "ours" if entry.seeds else "paper",
            }  # fmt: skip
            for name in names:
                spread = entry.scores.get(name)
                line[f"{name}_mean"] = spread.mean if spread else None
                line[f"{name}_sd"] = spread.sd if spread else None
            line["seeds"] = " ".join(str(seed) for seed in entry.seeds)
            line["differs"] = "; ".join(entry.differs)
            lines.append(line)
    return lines


def _row_of(table: PublishedTable, ours: _Ours) -> PublishedRow | None:
    """Row of a table that a run reproduces; none if the run does not belong in the table."""
    rows = {row.experiment: row for row in table.rows if row.experiment}
    if table is TABLE_3A:
        name = _prior_experiment(ours)
    elif table is TABLE_3B:
        name = _share_experiment(ours)
    else:
        (own,) = rows
        name = own if own == ours.experiment.name or ours.data == table.dataset else None
    return None if name is None else rows.get(name)


def _prior_experiment(ours: _Ours) -> str | None:
    if is_adversarial(ours.settings) or ours.experiment.name == "table3a_adversarial":
        return "table3a_adversarial"
    others = [other for other in ours.study.experiments if is_adversarial(other.method)]
    compares = _is_compared_with(ours, others)
    return "table3a_knowledge" if compares or ours.experiment.name == "table3a_knowledge" else None


def _share_experiment(ours: _Ours) -> str | None:
    """Experiment of Table 3 (b) with the nearest share of 3D labels; none for other kinds of runs."""
    share = share_of_3d(ours.settings)
    if share:
        return "table3b_100" if share > 0.5 else "table3b_10"
    if ours.experiment.name in ("table3b_0", "table3b_10", "table3b_100"):
        return ours.experiment.name
    others = [other for other in ours.study.experiments if share_of_3d(other.method)]
    return "table3b_0" if _is_compared_with(ours, others) else None


def _is_compared_with(ours: _Ours, others: Sequence[Experiment]) -> bool:
    """True if a run has full knowledge, no 3D labels, and the data term of one of the others."""
    if not is_full_knowledge(ours.settings) or share_of_3d(ours.settings):
        return False
    own = _data_term(ours.experiment)
    return any(_data_term(other) == own for other in others)


def _data_term(experiment: Experiment) -> dict[str, str]:
    settings = experiment.method.items()
    return {name: value for name, value in settings if name.startswith("data_term.")}


def _entries(
    table: PublishedTable, repeated: Sequence[tuple[_Ours, PublishedRow]]
) -> Iterator[Entry]:
    for row in table.rows:
        published = {name: Spread(value, None) for name, value in row.scores.items()}
        yield Entry(row.label, row.learns_from, published)
        below = [_entry(table, row, one) for one, repeats in repeated if repeats is row]
        yield from sorted(below, key=lambda entry: (len(entry.differs), entry.label, entry.differs))


def _entry(table: PublishedTable, row: PublishedRow, ours: _Ours) -> Entry:
    runs = ours.experiment.runs
    return Entry(
        label=f"ours, {ours.experiment.label}",
        learns_from=_learns_from(ours),
        scores=spreads([run.scores for run in runs]),
        seeds=tuple(run.seed for run in runs),
        differs=differences(ours.settings, table.dataset, str(row.experiment)),
    )


def _learns_from(ours: _Ours) -> str:
    if is_adversarial(ours.settings):
        return "2D, and 3D as prior"
    share = share_of_3d(ours.settings)
    return f"2D and 3D of {100 * share:.3g} %" if share else ONLY_2D


def _decimals(table: PublishedTable, name: str, entry: Entry) -> int:
    """Decimal places of a column: as many as the paper prints, at least two for our rows."""
    printed = (str(row.scores[name]) for row in table.rows if name in row.scores)
    return max(2 if entry.seeds else 1, *(len(text.partition(".")[-1]) for text in printed))
