"""Hands over time: jitter, and how much the lengths of one hand's bones change."""

from dataclasses import dataclass

import numpy as np

from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.motion.jitter import jitter_millimetres
from hand_recon.plausibility.findings import PHALANGES, bone_lengths
from hand_recon.plausibility.given_hands import as_array, rows_by
from hand_recon.plausibility.posed_hands import PosedHands


@dataclass(frozen=True)
class SequenceFindings:
    """Measurements of one hand over several frames; NaN where there is none."""

    name: str
    """Name of the sequence."""
    frames: int
    """Number of frames with landmarks."""
    jitter: float
    """Mean size of the landmarks' acceleration, mm/s²."""
    bone_variation: float
    """Greatest standard deviation of a phalanx's length over its mean, percent."""
    bone: str
    """Landmark at the outer end of that bone; empty without landmarks."""


def sequence_findings(hands: PosedHands) -> list[SequenceFindings]:
    """Measure every sequence of two frames or more.

    Args:
        hands: Hands; those of one sequence are frames of one hand.
    """
    names = hands.given.sequences
    found = []
    for name, rows in rows_by(names).items():
        if name and len(rows) > 1:
            found.append(_measured(hands, name, rows))
    return found


def _measured(hands: PosedHands, name: str, rows: list[int]) -> SequenceFindings:
    # As they are given where they are: those of a fit have the bones of one hand model.
    given = hands.points[rows]
    points = given if bool(given.isfinite().any()) else hands.landmarks[rows]
    whole = points.isfinite().flatten(1).all(dim=1)
    array, times = as_array(points[whole]), as_array(hands.given.times[rows][whole])
    if len(array) < 2:
        return SequenceFindings(name, len(array), float("nan"), float("nan"), "")
    order = np.argsort(times, kind="stable")
    jitter = float("nan")
    if np.isfinite(times).all() and (np.diff(times[order]) > 0).all():
        jitter = jitter_millimetres(array[order], times[order])
    lengths = as_array(bone_lengths(points[whole]))[:, list(PHALANGES)]
    variation = 100 * lengths.std(axis=0) / lengths.mean(axis=0)
    worst = int(variation.argmax())
    return SequenceFindings(
        name, len(array), jitter, float(variation[worst]), LANDMARKS[PHALANGES[worst]]
    )
