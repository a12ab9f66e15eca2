"""Names of scores in reports: the standard name beside the paper's symbol."""

from typing import Final

STANDARD_NAMES: Final = {"E_J": "PA-MPJPE (E_J)", "E_V": "PA-MPVPE (E_V)"}
"""Standard name, with the paper's symbol, of every score whose key is that symbol alone."""


def heading(name: str, unit: str | None = None) -> str:
    """Heading of a score, with its unit if there is one.

    >>> heading("E_J", "mm"), heading("AUC_J")
    ('PA-MPJPE (E_J), mm', 'AUC_J')

    Args:
        name: Key of the score, as in `metrics.json`.
        unit: Unit of the score.
    """
    standard = STANDARD_NAMES.get(name, name)
    return f"{standard}, {unit}" if unit else standard
