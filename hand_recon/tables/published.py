"""Tables 2 and 3 of the paper: other methods, another prior, and shares of 3D labels (Sec. 4.3, 5)."""

from dataclasses import dataclass
from typing import Final

ONLY_2D: Final = "2D"
WITH_3D: Final = "2D and 3D"
"""Labels of the methods with an asterisk in Table 2: also 3D annotations of synthetic or real hands."""


@dataclass(frozen=True)
class PublishedRow:
    """One row of a table, with the numbers that the paper prints."""

    label: str
    """Name of the method."""
    learns_from: str
    """Labels that the method was trained with."""
    scores: dict[str, float]
    """Scores by name; without those that the paper does not print."""
    experiment: str | None = None
    """Our experiment that reproduces the row; none for other authors' methods."""


@dataclass(frozen=True)
class PublishedTable:
    """A table of the paper, or the columns of one dataset in it."""

    key: str
    """Identifier in the CSV file."""
    title: str
    """Title in reports."""
    dataset: str
    """Dataset of all scores, by its datamodule's name."""
    scores: tuple[str, ...]
    """Columns of numbers."""
    rows: tuple[PublishedRow, ...]
    """Rows from top to bottom."""


DATASETS: Final = {"freihand": "FreiHAND", "dexycb": "DexYCB", "ho3d": "HO3D"}
"""Datasets of the paper by their datamodules' names. HO3D is its version 3."""

TEST_HANDS: Final = {"freihand": 3_960, "ho3d": 20_137}
"""Number of hands in the official test sets; DexYCB's depends on which frames are dropped."""

_METHODS: Final = (
    ("Boukhayma et al., CVPR 2019", WITH_3D),
    ("Spurr et al., ECCV 2020", WITH_3D),
    ("Chen et al., CVPR 2021", ONLY_2D),
    ("Ren et al., 2022", ONLY_2D),
    ("Jiang et al., 2023", ONLY_2D),
    ("the paper", ONLY_2D),
)
"""Rows of Table 2: method and labels."""

_COLUMNS: Final[dict[str, dict[str, tuple[float | None, ...]]]] = {
    "freihand": {
        "E_J": (11.0, 11.3, 11.8, 10.7, 10.8, 8.5),
        "E_V": (10.9, None, 11.9, 11.0, 10.9, 8.9),
    },
    "dexycb": {
        "E_J": (None, 7.1, None, None, None, 6.7),
        "E_RV": (27.3, None, None, None, None, 22.0),
    },
    "ho3d": {
        "E_J": (None, None, 11.5, None, 10.5, 10.0),
        "AUC_J": (None, None, 0.769, None, 0.789, 0.800),
        "E_V": (None, None, 11.1, None, 10.7, 9.8),
        "AUC_V": (None, None, 0.778, None, 0.785, 0.804),
    },
}
"""Columns of Table 2, from top to bottom; none for a dash."""


def _table_2(dataset: str) -> PublishedTable:
    columns = _COLUMNS[dataset]
    rows = []
    for position, (label, learns_from) in enumerate(_METHODS):
        known = {name: values[position] for name, values in columns.items()}
        scores = {name: value for name, value in known.items() if value is not None}
        own = position == len(_METHODS) - 1
        if scores:
            experiment = f"table2_{dataset}" if own else None
            rows.append(PublishedRow(label, learns_from, scores, experiment))
    title = f"Table 2: {DATASETS[dataset]}"
    return PublishedTable(f"2_{dataset}", title, dataset, tuple(columns), tuple(rows))


TABLES_2: Final = tuple(_table_2(dataset) for dataset in DATASETS)
"""Weakly supervised methods, one table per dataset."""

TABLE_3A: Final = PublishedTable(
    "3a", "Table 3 (a): knowledge against a prior from 3D data, on DexYCB", "dexycb", ("E_J", "E_V"),
    (
        PublishedRow(
            "FreiHAND-3D", "2D, and 3D of FreiHAND as prior", {"E_J": 8.3, "E_V": 8.5},
            "table3a_adversarial",
        ),
        PublishedRow("the paper", ONLY_2D, {"E_J": 6.7, "E_V": 7.1}, "table3a_knowledge"),
    ),
)  # fmt: skip
"""A discriminator trained on FreiHAND's 3D hands, and the paper's prior; both with DexYCB's 2D labels."""

TABLE_3B: Final = PublishedTable(
    "3b", "Table 3 (b): shares of 3D labels, on FreiHAND", "freihand", ("E_J", "E_V", "E_RV"),
    (
        PublishedRow(
            "100 %, fully supervised", "2D and 3D of 100 %", {"E_J": 8.30, "E_V": 8.4, "E_RV": 21.5},
            "table3b_100",
        ),
        PublishedRow(
            "the paper, 0 %", ONLY_2D, {"E_J": 8.52, "E_V": 8.9, "E_RV": 18.4}, "table3b_0"
        ),
        PublishedRow(
            "the paper, 10 %", "2D and 3D of 10 %", {"E_J": 8.26, "E_V": 8.6, "E_RV": 16.9},
            "table3b_10",
        ),
    ),
)  # fmt: skip
"""Shares of 3D labels; the paper does not say that the fully supervised row has the prior."""
