"""Verdicts on fitted hands: a fit that cannot be right is marked, with the reasons (decision 59).

A hand is doubtful if its landmarks, its camera or its fit has a property that good input does not lead to.
The limits were measured with `tools/measure_verdicts.py`. Two mistakes leave no trace in the landmarks of one
hand, and no verdict finds them: the wrong side, and images or coordinates that are mirrored.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import torch

from hand_recon.data.landmarks.image_landmarks import FEWEST
from hand_recon.fitting.doubts.anatomy import anatomy_doubts
from hand_recon.fitting.doubts.camera import camera_doubts
from hand_recon.fitting.doubts.landmarks import landmark_doubts, order_doubts
from hand_recon.fitting.doubts.reasons import Reasons
from hand_recon.fitting.doubts.residuals import residual_doubts
from hand_recon.fitting.fitted_hands import FittedHands

PLAUSIBLE: Final = "plausible"
"""Value of a verdict without reasons."""

DOUBTFUL: Final = "doubtful"
"""Value of the verdict on a hand that was fitted, and that has a reason not to be trusted."""

NOT_FITTED: Final = "not fitted"
"""Value of the verdict on a hand without a result."""


@dataclass(frozen=True)
class Verdict:
    """Judgement of one fitted hand."""

    value: str
    """`plausible`, `doubtful` or `not fitted`."""
    reasons: tuple[str, ...] = ()
    """One sentence for each reason: the finding, the limit and the remedy; none for a plausible hand."""


def verdicts(
    hands: FittedHands, image_sizes: Sequence[tuple[int, int] | None] | None = None
) -> list[Verdict]:
    """Judge fitted hands.

    The side of a hand is not judged: seen from afar, the landmarks of a right hand are those of a left hand
    that is turned over, and the wrong side fits as well (decision 59).

    Args:
        hands: Hands as they were fitted.
        image_sizes: Width and height of each hand's image, pixels, None where unknown; None if all are
            unknown. With it, a known camera is compared with its image.

    Returns:
        One verdict per hand, in order.

    Raises:
        ValueError: There is not one image size per hand.
    """
    if image_sizes is not None and len(image_sizes) != len(hands):
        raise ValueError(
            f"Found {len(image_sizes)} image sizes for {len(hands)} hands; expected one for each, None "
            "where it is unknown."
        )
    found = list(doubts(hands, image_sizes or [None] * len(hands)).values())
    return [
        _judged(hand, found) if fitted else Verdict(NOT_FITTED, (_missing_result(hands, hand),))
        for hand, fitted in enumerate(hands.fitted.tolist())
    ]


def doubts(hands: FittedHands, image_sizes: Sequence[tuple[int, int] | None]) -> dict[str, Reasons]:
    """Run all checks.

    Args:
        hands: Hands as they were fitted; sentences on hands without a result mean nothing.
        image_sizes: Width and height of each hand's image, pixels; None where unknown.

    Returns:
        Reasons by the check's name, those of the input before those of the fit.
    """
    of_the_fit = residual_doubts(hands) | anatomy_doubts(hands)
    suspects = sorted({hand for found in of_the_fit.values() for hand in found})
    return {
        **landmark_doubts(hands),
        **camera_doubts(hands, image_sizes),
        **of_the_fit,
        **order_doubts(hands, suspects),
    }


def _judged(hand: int, found: list[Reasons]) -> Verdict:
    reasons = tuple(some[hand] for some in found if hand in some)
    return Verdict(DOUBTFUL if reasons else PLAUSIBLE, reasons)


def _missing_result(hands: FittedHands, hand: int) -> str:
    """Cause for which a hand has no result."""
    observed = hands.observed
    labelled = int(observed.labelled[hand].sum())
    if labelled < FEWEST:
        return (
            f"{labelled} landmarks are given, and a fit needs {FEWEST} or more: give more of the 21, or "
            "leave the hand out."
        )
    if not bool(observed.usable[hand]):
        return (
            f"All {labelled} given landmarks are one point: check the coordinates, and write null for "
            "landmarks that were not found."
        )
    given = observed.landmarks_2d[hand][observed.labelled[hand]]
    if not bool(torch.isfinite(given).all()):
        return "A given landmark is not finite: write null for landmarks that were not found."
    return (
        "The fitted numbers are not finite: check the camera matrix, and that landmarks are in pixels of the "
        "image."
    )
