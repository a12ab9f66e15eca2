"""Coordinates that stand for a landmark that was not found (decision 57)."""

import logging
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

logger = logging.getLogger(__name__)

PLACEHOLDERS: Final = ("missing", "keep")
"""Possible treatments of placeholder coordinates."""

KNOWN: Final = ((0.0, 0.0), (-1.0, -1.0))
"""Pairs that tools write for a landmark that was not found: OpenPose (0, 0), DexYCB (−1, −1)."""

FEWEST_OTHERS: Final = 6
"""Least number of distinct other landmarks against which a repeated pair counts as far away."""


def at_placeholders(
    points: Float[np.ndarray, "hand landmark=21 2"],
) -> Bool[np.ndarray, "hand landmark=21"]:
    """Mask of the landmarks whose coordinates are placeholders.

    These are (0, 0) and (−1, −1) exactly, unless most of the hand has negative coordinates, as in coordinates
    relative to the wrist; and any pair that two or more landmarks of a hand have exactly, farther from all
    others than their box is large.
    """
    known = np.zeros(points.shape[:2], dtype=bool)
    for pair in KNOWN:
        known |= (points == pair).all(axis=-1)
    others = np.isfinite(points).all(axis=-1) & ~known
    negative = others & (points < 0).any(axis=-1)
    known &= (2 * negative.sum(axis=1) <= others.sum(axis=1))[:, None]
    for hand in np.flatnonzero(_with_repeated_pairs(points)):
        known[hand] |= _repeated_far_away(points[hand], known[hand])
    return known


def say_placeholders(
    path: Path,
    points: Float[np.ndarray, "hand landmark=21 2"],
    nowhere: Bool[np.ndarray, "hand landmark=21"],
) -> None:
    """Log which coordinates are read as missing, and at how many landmarks."""
    if nowhere.any():
        pairs = sorted({(float(u), float(v)) for u, v in points[nowhere]})
        logger.info(
            "%s: %d landmarks of %d hands are exactly at %s without a score and are read as missing, as no "
            "hand is there in practice; set placeholders=keep to use them.",
            path, int(nowhere.sum()), int(nowhere.any(axis=1).sum()),
            " or ".join(f"({u:g}, {v:g})" for u, v in pairs[:3]),
        )  # fmt: skip


def _with_repeated_pairs(
    points: Float[np.ndarray, "hand landmark=21 2"],
) -> Bool[np.ndarray, " hand"]:
    """Mask of the hands in which two landmarks have the same coordinates."""
    pairs = np.sort(points[..., 0] + 1j * points[..., 1], axis=1)
    return np.asarray((pairs[:, 1:] == pairs[:, :-1]).any(axis=1))


def _repeated_far_away(
    points: Float[np.ndarray, "landmark=21 2"], known: Bool[np.ndarray, " landmark=21"]
) -> Bool[np.ndarray, " landmark=21"]:
    """Mask of the landmarks that share a pair of coordinates far from all other landmarks."""
    found = np.zeros(len(points), dtype=bool)
    there = np.isfinite(points).all(axis=-1) & ~known
    pairs, counts = np.unique(points[there], axis=0, return_counts=True)
    if len(pairs) <= FEWEST_OTHERS:
        return found
    for pair in pairs[counts > 1]:
        same = there & (points == pair).all(axis=-1)
        others = points[there & ~same]
        low, high = others.min(axis=0), others.max(axis=0)
        distance = np.maximum(np.maximum(low - pair, pair - high), 0).max()
        if distance > (high - low).max():
            found |= same
    return found
