"""Learning curves from a run's CSV log."""

import csv
from dataclasses import dataclass
from pathlib import Path


def read_log(path: Path) -> dict[str, list[tuple[float, float]]]:
    """Read Lightning's `metrics.csv`: (epoch, value) of every logged quantity, by name."""
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
        target: PNG file to write.

    Returns:
        Names of the quantities that were drawn.
    """
    # Half a second, which commands that draw no curves should not wait for.
    from matplotlib.figure import Figure

    series = read_log(log)
    panels = [
        _Panel("Loss", _present(series, "train/loss", "val/loss"), logarithmic=True),
        _Panel(
            "Data term and weighted prior (training)",
            _present(series, "train/data")
            + [name for name in series if name.startswith("train/weighted/")],
            logarithmic=True,
        ),
        _Panel("Scores on the validation hands, mm", _present(series, "val/E_J", "val/E_V")),
        _Panel("2D error, pixels of a 224-pixel crop", _present(series, "val/E_2D")),
    ]
    panels = [panel for panel in panels if panel.names]
    # Without pyplot, which keeps global state and may ask for a display.
    figure = Figure(figsize=(10, 3.2 * max(1, (len(panels) + 1) // 2)), layout="constrained")
    for position, panel in enumerate(panels, start=1):
        axes = figure.add_subplot((len(panels) + 1) // 2, 2, position)
        for name in panel.names:
            epochs, values = zip(*series[name], strict=True)
            axes.plot(epochs, values, marker=".", label=name)
        axes.set(title=panel.title, xlabel="epoch")
        if panel.logarithmic and all(
            value > 0 for name in panel.names for _, value in series[name]
        ):
            axes.set_yscale("log")
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(target, dpi=100)
    return [name for panel in panels for name in panel.names]


@dataclass(frozen=True)
class _Panel:
    """The quantities on one set of axes."""

    title: str
    names: list[str]
    logarithmic: bool = False


def _present(series: dict[str, list[tuple[float, float]]], *names: str) -> list[str]:
    return [name for name in names if name in series]
