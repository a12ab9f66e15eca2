"""Draws the error of networks over the number of photographs that they were trained on.

    python tools/draw_fewer_photos.py <folder of runs> --all 11860 --output docs/images/fewer_photos.png

The runs are those of `make fewer-photos`. E_2D is on the test photographs, against their labels; the line of
a network from ImageNet weights is apart from that of one from random weights.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from hand_recon.tables.runs import FinishedRun, read_run, run_folders

SIZE = "photos.train_size"
WEIGHTS = "model.encoder.weights"
COLOURS = {"imagenet": "#0072b2", "none": "#d55e00"}
TITLES = {"imagenet": "from ImageNet weights", "none": "from random weights"}

Curves = dict[str, list[tuple[int, float]]]
"""Number of photographs and E_2D, by the weights that training began with, fewest photographs first."""


def curves_of(runs: Sequence[FinishedRun], every: int) -> Curves:
    """Sort the scores of runs into curves.

    Args:
        runs: Runs with E_2D among their scores.
        every: Number of photographs of a run that has no limit.

    Raises:
        ValueError: A run has no E_2D.
    """
    curves: Curves = defaultdict(list)
    for run in runs:
        if "E_2D" not in run.scores:
            raise ValueError(
                f"{run.folder} has no E_2D; expected runs tested on photographs. Train with "
                "photos.test=<labels>."
            )
        size = run.settings.get(SIZE, "None")
        photographs = int(size) if size.isdecimal() else every
        curves[run.settings.get(WEIGHTS, "none")].append((photographs, run.scores["E_2D"]))
    return {weights: sorted(points) for weights, points in curves.items()}


def draw(curves: Curves) -> Figure:
    """Draw the curves, with every value beside its point."""
    figure = Figure(figsize=(5.2, 3.4), layout="constrained")
    axes = figure.add_subplot()
    for weights, points in sorted(curves.items()):
        sizes, errors = zip(*points, strict=True)
        colour = COLOURS.get(weights, "#555555")
        axes.plot(sizes, errors, "o-", color=colour, label=TITLES.get(weights, weights))
        for size, error in points:
            axes.annotate(
                f"{error:.1f}", (size, error), (0, 7), textcoords="offset points", ha="center",
                color=colour, fontsize=8,
            )  # fmt: skip
    ticks = sorted({size for points in curves.values() for size, _ in points})
    axes.set_xscale("log")
    axes.set_xticks(ticks, [f"{tick:,}" for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    axes.set_xlabel("photographs with 2D labels")
    axes.set_ylabel("E_2D on other people, px of 224")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


def main(words: Sequence[str] | None = None) -> None:
    """Read the runs, print their curves and draw them.

    Args:
        words: The command line; none for this process's own.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("runs", nargs="+", help="runs, or folders of them")
    parser.add_argument(
        "--all", type=int, required=True, help="photographs of a run without photos.train_size"
    )
    parser.add_argument("--output", type=Path, required=True, help="PNG to draw")
    given = parser.parse_args(words)
    read = [read_run(folder) for folder in run_folders(given.runs)]
    curves = curves_of([run for run in read if isinstance(run, FinishedRun)], given.all)
    if not curves:
        raise SystemExit(f"Found no finished run in {', '.join(given.runs)}.")
    for weights, points in sorted(curves.items()):
        print(weights, ", ".join(f"{size}: {error:.2f} px" for size, error in points))
    draw(curves).savefig(given.output, dpi=150)


if __name__ == "__main__":
    main()
