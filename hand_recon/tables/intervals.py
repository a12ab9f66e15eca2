"""Bootstrap intervals over test hands: how much of a difference is the choice of hands."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

LEVEL: Final = 0.95
"""Share of the resamples that an interval holds."""

_CHUNK: Final = 500
"""Resamples drawn together, so that memory does not grow with their number."""


@dataclass(frozen=True)
class Interval:
    """A percentile interval."""

    low: float
    """Its lower end."""
    high: float
    """Its upper end."""

    def excludes(self, value: float) -> bool:
        """Whether a value lies outside."""
        return not self.low <= value <= self.high


@dataclass(frozen=True)
class Bootstrap:
    """Draws hands with replacement; the same seed draws the same hands.

    Several columns are resampled together, hand by hand, so that what is made of two means, such as
    their difference, is paired.
    """

    resamples: int = 5000
    """How often the hands are drawn."""
    seed: int = 0
    """Of the draws."""

    def means(self, columns: Float[np.ndarray, "hand column"]) -> Float[np.ndarray, "draw column"]:
        """The mean of every column over each draw of hands.

        Raises:
            ValueError: There is no hand.
        """
        hands = len(columns)
        if hands == 0:
            raise ValueError("There is no hand to draw from.")
        generator = np.random.default_rng(self.seed)
        parts = []
        for start in range(0, self.resamples, _CHUNK):
            size = (min(_CHUNK, self.resamples - start), hands)
            parts.append(columns[generator.integers(hands, size=size)].mean(axis=1))
        return np.concatenate(parts)


def interval(draws: Float[np.ndarray, " draw"]) -> Interval:
    """The middle `LEVEL` of some draws."""
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(low), float(high))
