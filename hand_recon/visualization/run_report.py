"""Report of a run: one HTML page without external files, with scores, curves, overlays and settings."""

import base64
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2

from hand_recon.visualization.overlay import COLUMNS
from hand_recon.visualization.score_names import heading

SCORES = {
    "E_J": "landmarks after Procrustes alignment, mm",
    "E_V": "vertices after Procrustes alignment, mm",
    "E_RV": "vertices relative to the wrist, mm",
    "MPJPE": "landmarks relative to the wrist, mm",
    "AUC_J": "area under the PCK curve of landmarks, 0–50 mm",
    "AUC_V": "area under the PCK curve of vertices, 0–50 mm",
    "F@5": "F-score of aligned vertices at 5 mm",
    "F@15": "F-score of aligned vertices at 15 mm",
    "E_2D": "projected landmarks, pixels of a 224-pixel crop",
    "PR": "hands that penetrate themselves deeper than 6 mm, %",
    "ROM": "hands with a joint more than 22.5° outside its range of motion, %",
    "ROM_degrees": "largest angle outside a range, mean over hands, degrees",
    "coverage_1sigma": "share of errors within 1σ; calibrated is 0.683",
    "coverage_2sigma": "share of errors within 2σ; calibrated is 0.954",
    "ECE": "mean gap between nominal and true coverage, 0–1",
    "rank_sigma_noise": "rank correlation of σ with the true noise of the labels",
    "rank_sigma_error": "rank correlation of σ with the error",
    "AUSE": "area between the sparsification curves by σ and by the error itself",
    "sigma_median": "median of σ, pixels of a 224-pixel crop",
}
"""Explanations of the scores, in the order of the page; other scores follow in their own order."""


@dataclass(frozen=True)
class Report:
    """Content of a report."""

    title: str
    """Title of the page."""
    scores: dict[str, float]
    """Scores of this model on the test hands."""
    baseline: dict[str, float]
    """Scores of the constant mean pose on the same hands; empty without 3D ground truth."""
    facts: dict[str, Any]
    """Further lines about the run, by name."""
    overlays: tuple[Path, ...]
    """Overlays (PNG) of test hands, smallest error first."""
    curves: Path | None
    """Learning curves (PNG)."""
    config: str
    """Resolved settings, YAML."""
    figures: tuple[tuple[str, Path], ...] = ()
    """Captions and files (PNG) of further figures, in the order of the page."""


def write_report(report: Report, target: Path) -> None:
    """Write the page with all images embedded."""
    source = (files("hand_recon.visualization") / "run_report.html.jinja").read_text(
        encoding="utf-8"
    )
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    names = [*SCORES, *(name for name in report.scores if name not in SCORES)]
    page = environment.from_string(source).render(
        report=report,
        rows=[
            (heading(name), SCORES.get(name, ""), report.scores[name], report.baseline.get(name))
            for name in names
            if name in report.scores
        ],
        columns=COLUMNS,
        overlays=[embedded(path) for path in report.overlays],
        curves=embedded(report.curves) if report.curves else None,
        figures=[(caption, embedded(path)) for caption, path in report.figures],
    )
    target.write_text(page, encoding="utf-8")


def embedded(path: Path) -> str:
    """A PNG file as a base64 data URI."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")
