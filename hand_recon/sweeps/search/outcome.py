"""Table, plot and best settings of a search."""

import csv
import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.table import Table

from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.sweeps.search.space import overrides
from hand_recon.sweeps.search.study import ERROR, PRUNED, Searched

logger = logging.getLogger(__name__)

TRIALS_FILE = "trials.csv"
"""File with one row per trial."""

BEST_FILE = "best.json"
"""File of the best trial: number, value, settings."""

PLOT_FILE = "search.png"
"""File of the plot."""


@dataclass(frozen=True)
class Outcome:
    """A search as far as it came."""

    folder: Path
    """Folder of the search."""
    searched: Searched
    """Settings of the search."""
    trials: list[Any]
    """Optuna's trials, in their order."""

    @property
    def complete(self) -> list[Any]:
        """Trials that ended well, the best one first."""
        done = [one for one in self.trials if one.state.name == "COMPLETE"]
        sign = 1 if self.searched.direction == "minimize" else -1
        return sorted(done, key=lambda one: sign * one.value)

    def counts(self) -> dict[str, int]:
        """Trials in each state."""
        names = [one.state.name.lower() for one in self.trials]
        return {name: names.count(name) for name in dict.fromkeys(names)}


def write_outcome(outcome: Outcome) -> dict[str, Any]:
    """Print the table, and write it, the plot and the best settings in place of earlier ones.

    Returns:
        What `best.json` holds.

    Raises:
        ValueError: No trial has ended well.
    """
    from hand_recon.sweeps.search.plot import draw_search

    _write_csv(outcome)
    Console().print(_table(outcome))
    if not outcome.complete:
        failed = next((one for one in outcome.trials if ERROR in one.user_attrs), None)
        reason = "" if failed is None else f" Trial {failed.number}: {failed.user_attrs[ERROR]}"
        raise ValueError(f"None of {len(outcome.trials)} trials has ended well.{reason}")
    best = outcome.complete[0]
    told = {
        "trial": best.number,
        outcome.searched.objective: best.value,
        "overrides": [*outcome.searched.overrides, *overrides(best.params)],
        "trials": outcome.counts(),
    }
    with replaced_when_whole(outcome.folder / BEST_FILE) as file:
        file.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    draw_search(outcome, outcome.folder / PLOT_FILE)
    logger.info("Best: hand-recon train %s", " ".join(told["overrides"]))
    logger.info("Open %s", outcome.folder / PLOT_FILE)
    return told


def _rows(outcome: Outcome) -> list[dict[str, str]]:
    return [
        {
            "trial": str(one.number),
            "state": one.state.name.lower(),
            outcome.searched.objective: "" if one.value is None else f"{one.value:.4f}",
            **{name: _number(one.params.get(name)) for name in outcome.searched.space},
            "note": _note(one),
        }
        for one in outcome.trials
    ]


def _note(trial: Any) -> str:  # noqa: ANN401  # Optuna's
    if ERROR in trial.user_attrs:
        return str(trial.user_attrs[ERROR])
    pruned = trial.user_attrs.get(PRUNED)
    return "" if pruned is None else f"ended at epoch {pruned}"


def _number(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _write_csv(outcome: Outcome) -> None:
    rows = _rows(outcome)
    with (
        replaced_when_whole(outcome.folder / TRIALS_FILE) as file,
        file.open("w", newline="") as out,
    ):
        writer = csv.DictWriter(out, fieldnames=list(rows[0]) if rows else ["trial"])
        writer.writeheader()
        writer.writerows(rows)


def _table(outcome: Outcome) -> Table:
    told = ", ".join(f"{count} {state}" for state, count in outcome.counts().items())
    table = Table(title=f"{len(outcome.trials)} trials: {told}")
    rows = _rows(outcome)
    for name in rows[0] if rows else ():
        justify: Literal["left", "right"] = "left" if name in ("state", "note") else "right"
        table.add_column(name, justify=justify, overflow="fold")
    best = outcome.complete[0].number if outcome.complete else None
    for row in rows:
        table.add_row(*row.values(), style="bold" if row["trial"] == str(best) else None)
    return table
