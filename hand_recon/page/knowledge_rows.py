"""The sources of knowledge one by one: the rows of Table 1 as fits of the same landmarks, and natural poses.

All rows of the paper begin at the same starts, without a lifter and without a table of poses, since these
would lend knowledge to rows that are to be without it (as `make table1-fit`).
"""

from dataclasses import dataclass
from typing import Final

from omegaconf import DictConfig, open_dict

from hand_recon.command_line.composing import composed
from hand_recon.runs.fit_run import adapted_to_data


@dataclass(frozen=True)
class KnowledgeRow:
    """One fit of the page: the knowledge that it has, in words and as settings."""

    key: str
    """Name in requests and answers."""
    title: str
    """Name that people read."""
    sentence: str
    """Explanation of what this row adds to the one before."""
    overrides: tuple[str, ...] = ()
    """Settings of `conf/predict.yaml`."""


_SAME_STARTS: Final = ("lifter=none", "descent.finger_table=false")

ROWS: Final = (
    KnowledgeRow(
        "none", "No knowledge",
        "The hand is placed where its landmarks fall on the given points, and nothing else is asked of it.",
        ("prior=none", "data_term=mse", *_SAME_STARTS),
    ),
    KnowledgeRow(
        "ranges", "Ranges of motion",
        "Every joint stays inside the range that was measured on living hands (Eq. 1).",
        ("prior=biomechanics", "data_term=mse", *_SAME_STARTS),
    ),
    KnowledgeRow(
        "anatomy", "Functional anatomy",
        "One joint's angle narrows another's range: a bent finger cannot be spread (Eq. 2 and 3).",
        ("prior=functional_anatomy", "data_term=mse", *_SAME_STARTS),
    ),
    KnowledgeRow(
        "penetration", "Non-penetration",
        "Parts of the hand do not pass through each other (Eq. 4).",
        ("prior=full", "data_term=mse", *_SAME_STARTS),
    ),
    KnowledgeRow(
        "likelihood", "Likelihood",
        "Landmarks count by their σ, so that an uncertain one pulls less (Eq. 6 and 7).",
        ("prior=full", "data_term=mse_then_nll", *_SAME_STARTS),
    ),
    KnowledgeRow(
        "natural", "Natural poses",
        "Beyond the paper: poses as living hands are held, and a lifter's start. It is what "
        "hand-recon predict does.",
    ),
)  # fmt: skip
"""Every row, with less knowledge first; the last is the page's own result."""


def row_config(row: KnowledgeRow, config: DictConfig) -> DictConfig:
    """Configuration of the fit of a row.

    Args:
        row: The row.
        config: `conf/demo.yaml` composed, whose detector, hand and camera all rows share.
    """
    found = composed("predict", ["input=[]", *row.overrides])
    with open_dict(found):
        found.detector, found.hand, found.camera = config.detector, config.hand, config.camera
    return adapted_to_data(found)
