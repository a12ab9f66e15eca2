"""Table 1 of the paper: what each row knows, and what it scored on FreiHAND (Sec. 4.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

KNOWLEDGE: Final = ("Biomechanics", "F-Anatomy", "Physics", "NLL")
"""The columns of check marks."""

COMPARED: Final = ("E_J", "E_V", "PR")
"""The columns of numbers: millimetres, millimetres, percent."""


SQUARED_ERRORS: Final = ("SquaredError", "RescaledSquaredError", "Staged")
"""Data terms that need no σ, and the one that is only a sequence of others; any other is a likelihood."""

LIKELIHOOD: Final = "NegativeLogLikelihood"
"""The paper's, with β = 0; the others are variants of it."""


@dataclass(frozen=True)
class PaperRow:
    """One row of Table 1."""

    number: int
    """From 1."""
    name: str
    """Of the experiment that repeats it."""
    title: str
    """As in Fig. 3."""
    knowledge: tuple[bool, bool, bool, bool]
    """The check marks, in the order of `KNOWLEDGE`."""
    scores: dict[str, float]
    """The paper's numbers, by the names in `COMPARED`."""


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
"""What the paper's numbers were measured on."""


def knowledge_of(method: Mapping[str, str]) -> tuple[bool, bool, bool, bool]:
    """The check marks that a method's settings amount to.

    Args:
        method: Settings by dotted name, as text.
    """
    return (
        _positive(method.get("prior.range_of_motion")),
        method.get("prior.functional_anatomy", "False") not in ("False", "None"),
        _positive(method.get("prior.non_penetration")),
        any(target not in SQUARED_ERRORS for target in _data_terms(method)),
    )


def is_papers(method: Mapping[str, str], row: PaperRow) -> tuple[bool, bool]:
    """Whether a method has the knowledge of a row, and whether its data term is the paper's own kind.

    Args:
        method: Settings by dotted name, as text.
        row: To compare with.
    """
    return knowledge_of(method) == row.knowledge, _is_plain(method)


def has_papers_likelihood(method: Mapping[str, str]) -> bool:
    """Whether a method's data term is the NLL of Sec. 3.3, from the start or after the squared error.

    Args:
        method: Settings by dotted name, as text.
    """
    return LIKELIHOOD in _data_terms(method) and _is_plain(method)


def _is_plain(method: Mapping[str, str]) -> bool:
    plain = all(term in ("SquaredError", "Staged", LIKELIHOOD) for term in _data_terms(method))
    weighted = any(_positive(value) for name, value in method.items() if name.endswith(".beta"))
    return plain and not weighted


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
