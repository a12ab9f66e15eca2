"""Tables 2 and 3 with our runs below the rows that they repeat, each with what it did otherwise."""

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

UNITS_2_3: Final = {**UNITS, "E_RV": "mm"}
"""Of the scores; areas under a curve have none."""


@dataclass(frozen=True)
class Entry:
    """One row: the paper's or ours."""

    label: str
    """What it is called."""
    learns_from: str
    """Labels that it was trained with."""
    scores: dict[str, Spread]
    """By name."""
    seeds: tuple[int, ...] = ()
    """That were averaged over; empty for the paper's."""
    differs: tuple[str, ...] = ()
    """What it did otherwise than the paper's row; empty for the paper's own."""


@dataclass(frozen=True)
class Beside:
    """A table of the paper with ours in it."""

    table: PublishedTable
    """The paper's."""
    entries: tuple[Entry, ...]
    """Every published row, each with ours below."""


@dataclass(frozen=True)
class _Ours:
    """One method in one study."""

    study: Study
    experiment: Experiment

    @property
    def settings(self) -> dict[str, str]:
        return self.study.settings | self.experiment.method

    @property
    def data(self) -> str | None:
        return self.study.settings.get("data")


def beside(studies: Sequence[Study]) -> tuple[Beside, ...]:
    """The tables for which there is any run of ours."""
    ours = [_Ours(study, experiment) for study in studies for experiment in study.experiments]
    found = []
    for table in (*TABLES_2, TABLE_3A, TABLE_3B):
        repeated = [(one, row) for one in ours if (row := _row_of(table, one)) is not None]
        if repeated:
            found.append(Beside(table, tuple(_entries(table, repeated))))
    return tuple(found)


def text_table(one: Beside) -> TextTable:
    """As text; a row of ours names what it did otherwise, the paper's have nothing to name."""
    names = one.table.scores
    headings = [f"{name}, {UNITS_2_3[name]}" if name in UNITS_2_3 else name for name in names]
    return TextTable(
        one.table.title,
        ("method", "learns from", *headings, "seeds", "otherwise than the paper"),
        tuple(
            (
                entry.label,
                entry.learns_from,
                *(
                    spread_text(entry.scores.get(name), _decimals(one.table, name, entry))
                    for name in names
                ),
                str(len(entry.seeds)) if entry.seeds else ABSENT,
                ("; ".join(entry.differs) or "nothing") if entry.seeds else "",
            )
            for entry in one.entries
        ),
    )


def notes_beside(one: Beside) -> list[str]:
    """What must be said below the table."""
    said = [
        "Rows without seeds are the paper's numbers. A row of ours compares with them only as far as its "
        "last column allows, which lists what the settings say; docs/decisions.md has what always differs."
    ]
    if one.table is TABLE_3B:
        said.append(
            "That the fully supervised row has no knowledge beyond the shape's is our reading of the paper."
        )
    if one.table.dataset == "ho3d":
        said.append("The paper's HO3D numbers are from the benchmark's server.")
    return said


def csv_rows_beside(tables: Sequence[Beside]) -> list[dict[str, str | float | None]]:
    """One line per row, numbers as they are; every line has the same columns."""
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
    """The row that a run repeats, if it has any business in a table."""
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
    """Of shares that the paper does not have, the nearest one's: the row says how many they were."""
    share = share_of_3d(ours.settings)
    if share:
        return "table3b_100" if share > 0.5 else "table3b_10"
    if ours.experiment.name in ("table3b_0", "table3b_10", "table3b_100"):
        return ours.experiment.name
    others = [other for other in ours.study.experiments if share_of_3d(other.method)]
    return "table3b_0" if _is_compared_with(ours, others) else None


def _is_compared_with(ours: _Ours, others: Sequence[Experiment]) -> bool:
    """Whether it has all knowledge, no 3D label, and the data term of one that has 3D as prior or label."""
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
    """As many as the paper prints in that column; two at least for ours."""
    printed = (str(row.scores[name]) for row in table.rows if name in row.scores)
    return max(2 if entry.seeds else 1, *(len(text.partition(".")[-1]) for text in printed))
