"""Bar chart of Table 1: the paper's PA-MPJPE (E_J) beside ours."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hand_recon.tables.summary import Row, Summary
from hand_recon.visualization.score_names import heading

_OURS: Final = "#2f6fb0"
_PAPERS: Final = "#c9c9c9"
_WIDTH: Final = 0.38


def draw_chart(summary: Summary, target: Path) -> bool:
    """Draw a pair of bars per row, with the standard deviation over seeds, and the mean pose.

    Args:
        summary: Study to draw.
        target: PNG to write.

    Returns:
        Whether the file was written: it is not where no row has an E_J.
    """
    rows = summary.table
    if not any("E_J" in row.scores for row in rows):
        return False
    # A figure without pyplot needs no display and has no global state.
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.add_subplot()
    _draw_bars(axes, rows)
    if "E_J" in summary.mean_pose:
        axes.axhline(
            summary.mean_pose["E_J"].mean, color="black", linewidth=1, linestyle=":",
            label="ours, mean pose",
        )  # fmt: skip
    labels = [row.label.replace(" ", "\n", 1) for row in rows]
    axes.set_xticks(range(len(rows)), labels, fontsize=9)
    axes.set(ylabel=heading("E_J", "mm"))
    axes.margins(y=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(target, dpi=120)
    return True


def _draw_bars(axes: Axes, rows: Sequence[Row]) -> None:
    papers = [row.paper.scores["E_J"] if row.paper else np.nan for row in rows]
    positions = np.arange(len(rows))
    paper_bars = axes.bar(
        positions - _WIDTH / 2, papers, _WIDTH, color=_PAPERS, label="paper (FreiHAND, MANO)"
    )
    scores = {index: row.scores["E_J"] for index, row in enumerate(rows) if "E_J" in row.scores}
    means = [score.mean for score in scores.values()]
    deviations = [score.sd or 0.0 for score in scores.values()]
    our_bars = axes.bar(
        np.array(list(scores)) + _WIDTH / 2, means, _WIDTH, yerr=deviations, capsize=3, color=_OURS,
        label="ours, ± standard deviation over seeds",
    )  # fmt: skip
    for bars in (paper_bars, our_bars):
        axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=2)
