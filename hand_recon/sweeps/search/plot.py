"""Plot of a search: the objective over the trials and over each searched setting."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from hand_recon.sweeps.search.outcome import Outcome

COLUMNS = 3
"""Panels beside each other."""


def draw_search(outcome: "Outcome", target: Path) -> None:
    """Draw a search.

    Args:
        outcome: With one trial or more that ended well.
        target: PNG file to write.
    """
    names = list(outcome.searched.space)
    rows = -(-(len(names) + 1) // COLUMNS)
    figure = Figure(figsize=(4 * COLUMNS, 3.2 * rows), layout="constrained")
    done = sorted(outcome.complete, key=lambda one: one.number)
    panels = [figure.add_subplot(rows, COLUMNS, place + 1) for place in range(len(names) + 1)]
    _draw_trials(panels[0], outcome, done)
    for axes, name in zip(panels[1:], names, strict=True):
        _draw_setting(axes, name, outcome, done)
    figure.savefig(target, dpi=100)


def _draw_trials(axes: Axes, outcome: "Outcome", done: Sequence[Any]) -> None:
    """The objective of each trial, and the best so far."""
    better = min if outcome.searched.direction == "minimize" else max
    numbers, values = [one.number for one in done], [one.value for one in done]
    best = [better(values[: place + 1]) for place in range(len(values))]
    axes.plot(numbers, values, "o", label="trial")
    axes.step(numbers, best, where="post", label="best so far")
    pruned = [one for one in outcome.trials if one.state.name == "PRUNED" and one.value is not None]
    if pruned:
        ended = [one.value for one in pruned]
        axes.plot([one.number for one in pruned], ended, "x", color="grey", label="ended early")
    failed = [one.number for one in outcome.trials if one.state.name == "FAIL"]
    for number in failed:
        axes.axvline(
            number, color="red", linewidth=0.8, label="failed" if number == failed[0] else None
        )
    axes.set(xlabel="trial", ylabel=outcome.searched.objective)
    axes.legend(fontsize=8)
    axes.grid(visible=True, alpha=0.3)


def _draw_setting(axes: Axes, name: str, outcome: "Outcome", done: Sequence[Any]) -> None:
    """The objective over a setting; the best trial is marked."""
    values = [one.params[name] for one in done]
    if not all(isinstance(value, int | float) for value in values):
        values = [str(value) for value in values]
    axes.plot(values, [one.value for one in done], "o")
    best = outcome.complete[0]
    place = done.index(best)
    axes.plot(values[place : place + 1], [best.value], "*", markersize=14, color="tab:orange")
    if outcome.searched.space[name].get("log"):
        axes.set_xscale("log")
        # Numbers within a decade stand close beside each other.
        axes.tick_params(axis="x", which="both", labelsize=7, rotation=40)
    axes.set(xlabel=name, ylabel=outcome.searched.objective)
    axes.grid(visible=True, alpha=0.3)
