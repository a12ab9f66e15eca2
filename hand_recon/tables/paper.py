"""Table 1 of the paper: knowledge and scores of each row, on FreiHAND (Sec. 4.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

KNOWLEDGE: Final = ("Biomechanics", "F-Anatomy", "Physics", "NLL")
"""Columns of check marks."""

COMPARED: Final = ("E_J", "E_V", "PR")
"""Columns of numbers: millimetres, millimetres, percent."""

SQUARED_ERRORS: Final = ("SquaredError", "RescaledSquaredError", "Staged")
"""Data terms without σ, and the sequence of two data terms; any other data term is a likelihood."""

LIKELIHOOD: Final = "NegativeLogLikelihood"
"""The paper's data term, with β = 0; other likelihoods are variants of it."""


@dataclass(frozen=True)
class PaperRow:
    """One row of Table 1."""

    number: int
    """Number of the row, from 1."""
    name: str
    """Name of the experiment that reproduces the row."""
    title: str
    """Title, as in Fig. 3."""
    knowledge: tuple[bool, bool, bool, bool]
    """Check marks, in the order of `KNOWLEDGE`."""
    scores: dict[str, float]
    """The paper's scores, by the names in `COMPARED`."""


def _row(number: int, title: str, *scores: float) -> PaperRow:
    known = (number > 1, number > 2, number > 3, number > 4)
    named = dict(zip(COMPARED, scores, strict=True))
    return PaperRow(number, f"ablation_row{number}", title, known, named)


TABLE_1: Final = (
    _row(1, "No Knowledge", 22.4, 24.8, 38.8),
    _row(2, "+Biomechanics", 10.9, 11.4, 11.4),
    _row(3, "++F-Anatomy", 9.6, 10.0, 11.4),
    _row(4, "+Physics", 9.4, 9.8, 1.9),
    _row(5, "+NLL", 8.5, 8.9, 1.3),
)
"""The five rows (Sec. 4.2)."""

CONDITIONS: Final = "FreiHAND with MANO, ResNet-50 at 224 px, 200 epochs"
"""Conditions of the paper's numbers."""


def knowledge_of(method: Mapping[str, str]) -> tuple[bool, bool, bool, bool]:
    """Check marks of a method, from its settings.

    Args:
        method: Settings by dotted name, as text.
    """
    return (
        _positive(method.get("prior.range_of_motion.weight")),
        "prior.range_of_motion.anatomy._target_" in method,
        _positive(method.get("prior.non_penetration.weight")),
        any(target not in SQUARED_ERRORS for target in _data_terms(method)),
    )


def is_papers(method: Mapping[str, str], row: PaperRow) -> tuple[bool, bool]:
    """Two flags: a method has the knowledge of a row; its data term is the paper's own kind.

    Args:
        method: Settings by dotted name, as text.
        row: Row of Table 1.
    """
    return knowledge_of(method) == row.knowledge, _is_unmodified(method)


def has_papers_likelihood(method: Mapping[str, str]) -> bool:
    """True if a method's data term is the NLL of Sec. 3.3, from the start or after the squared error.

    Args:
        method: Settings by dotted name, as text.
    """
    return LIKELIHOOD in _data_terms(method) and _is_unmodified(method)


def _is_unmodified(method: Mapping[str, str]) -> bool:
    unmodified = all(term in ("SquaredError", "Staged", LIKELIHOOD) for term in _data_terms(method))
    weighted = any(_positive(value) for name, value in method.items() if name.endswith(".beta"))
    return unmodified and not weighted


def _data_terms(method: Mapping[str, str]) -> list[str]:
    return [
        value.rpartition(".")[-1]
        for key, value in method.items()
        if key.startswith("data_term.") and key.endswith("_target_")
    ]


def _positive(text: str | None) -> bool:
    try:
        value = float(text or 0)
    except ValueError:
        return False
    return math.isfinite(value) and value > 0
