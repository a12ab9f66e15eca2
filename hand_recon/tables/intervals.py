"""Bootstrap confidence intervals over test hands."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

LEVEL: Final = 0.95
"""Confidence level: share of the resamples inside an interval."""

_CHUNK: Final = 500
"""Resamples drawn together, to bound the memory."""


@dataclass(frozen=True)
class Interval:
    """Percentile interval."""

    low: float
    """Lower end."""
    high: float
    """Upper end."""

    def excludes(self, value: float) -> bool:
        """True if a value lies outside the interval."""
        return not self.low <= value <= self.high


@dataclass(frozen=True)
class Bootstrap:
    """Resampling of hands with replacement; the same seed draws the same hands.

    Columns are resampled together, hand by hand, so that the difference or ratio of two means is paired.
    """

    resamples: int = 5000
    """Number of resamples."""
    seed: int = 0
    """Seed of the draws."""

    def means(self, columns: Float[np.ndarray, "hand column"]) -> Float[np.ndarray, "draw column"]:
        """Mean of every column over each resample of the hands.

        Raises:
            ValueError: There is no hand.
        """
        hands = len(columns)
        if hands == 0:
            raise ValueError("There is no hand to draw from; expected is at least one row.")
        generator = np.random.default_rng(self.seed)
        parts = []
        for start in range(0, self.resamples, _CHUNK):
            size = (min(_CHUNK, self.resamples - start), hands)
            parts.append(columns[generator.integers(hands, size=size)].mean(axis=1))
        return np.concatenate(parts)


def interval(draws: Float[np.ndarray, " draw"]) -> Interval:
    """Central interval that holds the share `LEVEL` of the draws."""
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(low), float(high))
