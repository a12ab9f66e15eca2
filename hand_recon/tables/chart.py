"""Table 1 as bars: the paper's E_J beside ours."""

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from hand_recon.tables.summary import Summary

_OURS: Final = "#2f6fb0"
_PAPERS: Final = "#c9c9c9"
_WIDTH: Final = 0.38


def draw_chart(summary: Summary, target: Path) -> bool:
    """Draw a pair of bars per row, with whiskers of a standard deviation over seeds, and the mean pose.

    Args:
        summary: Of a study.
        target: PNG to write.

    Returns:
        Whether there was anything to draw: no file is written where no row has an E_J.
    """
    rows = summary.table
    ours = [row.scores.get("E_J") for row in rows]
    if not any(ours):
        return False
    places = np.arange(len(rows))
    # A figure without pyplot: no display, and no global state.
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.add_subplot()
    papers = [row.paper.scores["E_J"] if row.paper else np.nan for row in rows]
    bars = axes.bar(
        places - _WIDTH / 2, papers, _WIDTH, color=_PAPERS, label="paper (FreiHAND, MANO)"
    )
    axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=2)
    run = [place for place, score in zip(places, ours, strict=True) if score]
    means = [score.mean for score in ours if score]
    whiskers = [score.sd or 0.0 for score in ours if score]
    bars = axes.bar(
        np.array(run) + _WIDTH / 2, means, _WIDTH, yerr=whiskers, capsize=3, color=_OURS,
        label="ours, ± standard deviation over seeds",
    )  # fmt: skip
    axes.bar_label(bars, fmt="%.1f", fontsize=8, padding=2)
    if "E_J" in summary.mean_pose:
        axes.axhline(
            summary.mean_pose["E_J"].mean, color="black", linewidth=1, linestyle=":",
            label="ours, mean pose",
        )  # fmt: skip
    axes.set_xticks(places, [row.label.replace(" ", "\n", 1) for row in rows], fontsize=9)
    axes.set(ylabel="E_J, mm")
    axes.margins(y=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(target, dpi=120)
    return True
