"""Marks of hands whose labels may be wrong, by the detector, the image and a fit (decision 70)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hand_recon.detection.detector import DetectedHand
from hand_recon.fitting.doubts.anatomy import anatomy_doubts
from hand_recon.fitting.doubts.residuals import residual_doubts
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.runs.labelling.label_records import extent_of

LOW_SCORE: Final = "low score"
SIDE: Final = "side uncertain"
SEVERAL: Final = "several hands"
OUTSIDE: Final = "outside the image"
UNCERTAIN: Final = "uncertain landmarks"
FIT: Final = "fit: "
"""Beginning of the names of marks by the fit; the name of the check follows."""


@dataclass(frozen=True)
class Limits:
    """Limits beyond which a hand is marked.

    Raises:
        ValueError: A limit is out of its range.
    """

    min_score: float = 0.9
    """Least presence, 0 to 1."""
    min_side_score: float = 0.8
    """Least probability of the side, 0 to 1."""
    max_sigma: float = 0.05
    """Greatest median σ of the landmarks, shares of the hand's extent."""
    max_outside: float = 0.1
    """Greatest distance of a landmark outside the image, shares of the hand's extent."""

    def __post_init__(self) -> None:
        for name in ("min_score", "min_side_score", "max_sigma", "max_outside"):
            value = getattr(self, name)
            top = 1.0 if name.startswith("min") else np.inf
            if not 0 <= value <= top:
                expected = "from 0 to 1" if top == 1.0 else "of at least 0"
                raise ValueError(f"Expected limits.{name} {expected}, found {value:g}.")


def marks_of_detection(
    hands: Sequence[DetectedHand], size: tuple[int, int], limits: Limits
) -> list[dict[str, str]]:
    """Marks of the hands of one image by what the detector says of them.

    Args:
        hands: The image's hands.
        size: Width and height of the image, pixels.
        limits: Limits of each mark.

    Returns:
        Sentence for each mark by its name, for each hand in order.
    """
    found = []
    for hand in hands:
        marks = _score_marks(hand, limits) | _place_marks(hand, size, limits)
        if len(hands) > 1:
            marks[SEVERAL] = (
                f"The image has {len(hands)} hands: parts of one may be taken for the other's, and crops "
                "around one show both."
            )
        found.append(marks)
    return found


def _score_marks(hand: DetectedHand, limits: Limits) -> dict[str, str]:
    marks = {}
    if hand.score is not None and hand.score < limits.min_score:
        marks[LOW_SCORE] = (
            f"The presence of a hand is {hand.score:.2f}, expected {limits.min_score:g} or more."
        )
    if hand.side_score < limits.min_side_score:
        marks[SIDE] = (
            f"The hand is a {hand.side} one with a probability of {hand.side_score:.2f}, expected "
            f"{limits.min_side_score:g} or more."
        )
    return marks


def _place_marks(hand: DetectedHand, size: tuple[int, int], limits: Limits) -> dict[str, str]:
    extent = max(extent_of(hand.landmarks_2d), 1e-9)
    beyond = np.maximum(-hand.landmarks_2d, hand.landmarks_2d - np.array(size))
    beyond = float(np.nanmax(beyond)) / extent
    marks = {}
    if beyond > limits.max_outside:
        marks[OUTSIDE] = (
            f"A landmark is {100 * beyond:.0f} % of the hand's extent outside the image, expected at most "
            f"{100 * limits.max_outside:g} %."
        )
    if hand.sigma is not None and np.isfinite(hand.sigma).any():
        sigma = float(np.nanmedian(hand.sigma)) / extent
        if sigma > limits.max_sigma:
            marks[UNCERTAIN] = (
                f"The median σ of the landmarks is {100 * sigma:.1f} % of the hand's extent, expected at "
                f"most {100 * limits.max_sigma:g} %: readings of rotated, scaled and mirrored copies of such "
                "a hand differ."
            )
    return marks


def marks_of_fit(hands: FittedHands) -> list[dict[str, str]]:
    """Marks of hands by the residuals and the anatomy of their fits (decision 59).

    Checks of the camera are left out, because it is assumed; so are those of σ and of the image's bounds,
    which `marks_of_detection` has.

    Args:
        hands: Hands as they were fitted.

    Returns:
        Sentence for each mark by its name, for each hand in order.
    """
    found = residual_doubts(hands) | anatomy_doubts(hands)
    return [
        {f"{FIT}{check}": some[hand] for check, some in found.items() if hand in some}
        if fitted
        else {f"{FIT}no result": "The fit of the hand has no finite result."}
        for hand, fitted in enumerate(hands.fitted.tolist())
    ]
