"""Measured rows of the benchmark."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Spread:
    """Median of several measurements, and the quartiles around it."""

    median: float
    low: float
    """First quartile."""
    high: float
    """Third quartile."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured work, and what it is compared with."""

    suite: str
    """Suite that measured it."""
    work: str
    """The work, in a few words."""
    size: str
    """Amount of work of one run, such as `64 hands`."""
    seconds: Spread
    """Time of one run."""
    items: float = 1.0
    """Hands, pictures or frames of one run, for the rate."""
    reference: str | None = None
    """The other side of the comparison; None for a work that stands alone."""
    reference_seconds: Spread | None = None
    """Its time for the same amount of work."""
    ratio: Spread | None = None
    """Time of the reference over that of the work, in pairs of runs that followed each other."""
    wanted_ratio: float | None = None
    """Least ratio that is aimed at."""
    wanted_seconds: float | None = None
    """Most seconds that are aimed at."""
    difference: str = ""
    """Largest difference between the values of both sides, with its unit."""
    megabytes: float | None = None
    """Growth of a fresh process at its peak, MB."""
    reference_megabytes: float | None = None
    """The same of the reference."""
    note: str = ""
    """Remark for the reader."""

    @property
    def name(self) -> str:
        """Key of the row among those of other runs."""
        return f"{self.suite}: {self.work}, {self.size}"

    @property
    def met(self) -> bool | None:
        """True if what is aimed at was reached; None if nothing is."""
        if self.wanted_ratio is not None and self.ratio is not None:
            return self.ratio.median >= self.wanted_ratio
        if self.wanted_seconds is not None:
            return self.seconds.median <= self.wanted_seconds
        return None


@dataclass(frozen=True)
class LeftOut:
    """Part of a suite that this machine cannot measure."""

    suite: str
    """The suite."""
    work: str
    """The work that was left out."""
    reason: str
    """The thing that is missing."""


def hands(count: int) -> str:
    """Number of hands, in words.

    Args:
        count: The number.
    """
    return f"{count} hand" if count == 1 else f"{count} hands"


def row_from(record: dict[str, Any]) -> Row:
    """Rebuild a row from its record in `benchmark.json`.

    Args:
        record: `dataclasses.asdict` of a row.
    """
    spreads = {
        key: None if record[key] is None else Spread(**record[key])
        for key in ("seconds", "reference_seconds", "ratio")
    }
    return Row(**(record | spreads))
