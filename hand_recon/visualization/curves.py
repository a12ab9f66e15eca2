"""Learning curves from a run's CSV log."""

import csv
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure


def read_log(path: Path) -> dict[str, list[tuple[float, float]]]:
    """Every logged quantity as (epoch, value), from Lightning's `metrics.csv`."""
    series: dict[str, list[tuple[float, float]]] = {}
    with path.open(newline="") as stream:
        for row in csv.DictReader(stream):
            for name, value in row.items():
                if value and name not in ("epoch", "step") and row.get("epoch"):
                    series.setdefault(name, []).append((float(row["epoch"]), float(value)))
    return series


def draw_curves(log: Path, target: Path) -> list[str]:
    """Draw the losses, the prior's terms and the scores over the epochs.

    Args:
        log: Lightning's `metrics.csv`.
        target: PNG to write.

    Returns:
        The names of the quantities drawn.
    """
    series = read_log(log)
    panels = [
        ("Loss", [name for name in ("train/loss", "val/loss") if name in series], True),
        ("Data term and weighted prior (training)",
         [name for name in series if name == "train/data" or name.startswith("train/weighted/")],
         True),
        ("Scores on the validation hands, mm",
         [name for name in ("val/E_J", "val/E_V") if name in series], False),
        ("2D error on the validation hands, pixels of a 224-pixel crop",
         [name for name in ("val/E_2D",) if name in series], False),
    ]  # fmt: skip
    panels = [panel for panel in panels if panel[1]]
    # An Agg canvas of its own: no display, and no global state of pyplot.
    mpl.use("agg", force=False)
    figure = Figure(figsize=(10, 3.2 * ((len(panels) + 1) // 2)), layout="constrained")
    for position, (title, names, logarithmic) in enumerate(panels, start=1):
        axes = figure.add_subplot((len(panels) + 1) // 2, 2, position)
        for name in names:
            epochs, values = zip(*series[name], strict=True)
            axes.plot(epochs, values, marker=".", label=name)
        axes.set(title=title, xlabel="epoch")
        if logarithmic and all(value > 0 for name in names for _, value in series[name]):
            axes.set_yscale("log")
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(target, dpi=100)
    return [name for _, names, _ in panels for name in names]
