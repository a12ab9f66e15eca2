"""Reasons to doubt fitted hands, by hand; lengths in the image relative to the hand's extent."""

from collections.abc import Callable

from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.data.landmarks.image_landmarks import boxes
from hand_recon.fitting.fitted_hands import FittedHands

Reasons = dict[int, str]
"""Sentence for each hand in which a check finds something, by the hand's position."""


def reasons(doubtful: Bool[Tensor, " hand"], sentence: Callable[[int], str]) -> Reasons:
    """Write a sentence for each hand of a mask."""
    return {hand: sentence(hand) for hand in doubtful.nonzero()[:, 0].tolist()}


def extents(hands: FittedHands) -> Float[Tensor, " hand"]:
    """Longer side of the box of each hand's landmarks, pixels of the image."""
    low, high = boxes(hands.observed)
    return (high - low).amax(dim=-1)
