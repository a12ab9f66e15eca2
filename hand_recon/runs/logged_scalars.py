"""Logged scalars of two runs, compared step by step and bit for bit."""

import csv
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Difference:
    """A scalar that two runs logged differently."""

    step: int
    """Optimizer step; that after the last one for a test score."""
    name: str
    """Name of the scalar."""
    was: float | None
    """Value in the earlier run; none where it has none."""
    now: float | None
    """Value in the later run; none where it has none."""

    @property
    def size(self) -> float:
        """Absolute difference; infinite where one is absent or not finite."""
        if self.was is None or self.now is None:
            return math.inf
        size = abs(self.was - self.now)
        return math.inf if math.isnan(size) else size


@dataclass(frozen=True)
class LogComparison:
    """Two runs' scalars beside each other."""

    steps: int
    """Steps that were compared."""
    values: int
    """Scalars that were compared."""
    differences: list[Difference]
    """Scalars that differ in a bit, in the order of the steps."""
    unfinished: bool
    """True if the later run has steps that the earlier one did not come to."""

    @property
    def same(self) -> bool:
        """True if nothing differs."""
        return self.values > 0 and not self.differences

    def told(self) -> str:
        """Result in a sentence."""
        if self.values == 0:
            return "The earlier run has logged nothing that could be compared."
        if not self.differences:
            far = ", as far as the earlier run came" if self.unfinished else ""
            return f"Same, bit for bit: {self.values} values of {self.steps} steps{far}."
        first = self.differences[0]
        largest = max(self.differences, key=lambda one: one.size)
        return (
            f"Not the same: from step {first.step} on, where {first.name} was {first.was} and is "
            f"{first.now} (a difference of {first.size:.3g}). {len(self.differences)} of {self.values} "
            f"values differ, most {largest.name} at step {largest.step}, by {largest.size:.3g}."
        )

    def entries(self) -> dict[str, Any]:
        """Entries for JSON."""
        return {
            "same": self.same,
            "told": self.told(),
            "steps": self.steps,
            "values": self.values,
            "different_values": len(self.differences),
            "first_differences": [vars(one) for one in self.differences[:20]],
        }


def compare_logs(before: Path, now: Path) -> LogComparison:
    """Compare all logged scalars and test scores of two runs.

    Args:
        before: Folder of the earlier run, which may have been interrupted.
        now: Folder of the later run.
    """
    first, second = _scalars(before), _scalars(now)
    last = max([*first, *second], default=0) + 1
    for scalars, folder in ((first, before), (second, now)):
        if scores := _test_scores(folder):
            scalars[last] = scores
    differences: list[Difference] = []
    for step in sorted(first):
        ours = second.get(step, {})
        for name in sorted(first[step].keys() | ours.keys()):
            was, is_now = first[step].get(name), ours.get(name)
            if not _equal(was, is_now):
                differences.append(Difference(step, name, was, is_now))
    values = sum(len(scalars) for scalars in first.values())
    return LogComparison(len(first), values, differences, bool(second.keys() - first.keys()))


def _scalars(folder: Path) -> dict[int, dict[str, float]]:
    """Logged scalars by step."""
    found: dict[int, dict[str, float]] = {}
    file = folder / "csv" / "metrics.csv"
    if not file.is_file():
        return found
    with file.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            step = int(row.pop("step"))
            values = {name: float(text) for name, text in row.items() if text}
            found.setdefault(step, {}).update(values)
    return found


def _test_scores(folder: Path) -> dict[str, float]:
    try:
        scores = json.loads((folder / "metrics.json").read_text(encoding="utf-8")).get("test", {})
    except (OSError, ValueError, AttributeError):
        return {}
    return {f"test/{name}": float(value) for name, value in scores.items()}


def _equal(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return one == other or (math.isnan(one) and math.isnan(other))
