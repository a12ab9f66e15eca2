"""Fit of hands of one person, which share their shape (Sec. 3.4)."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.descent import Descent, last_stage
from hand_recon.fitting.in_parts import PART, Fitter
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import SIGMA_AT_HALF_CONFIDENCE, observed
from hand_recon.fitting.shared_shape import shared_shape, with_shape
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandParameters

logger = logging.getLogger(__name__)

MOST: Final = 256
"""Most hands that a person's shape is estimated from, spread evenly over all."""


def one_person_fitter(
    fitter: Fitter,
    build: Callable[[HandModel], Fitter],
    objective: Objective,
    descent: Descent,
    hands: HandBatch,
    *,
    sigma_at_half_confidence: float = SIGMA_AT_HALF_CONFIDENCE,
) -> Fitter:
    """Estimate the shape of one person's hands, and build the fit of hands of this shape.

    Left hands mirror right ones and have the same shape.

    Args:
        fitter: Fit of the hand model, of any hands.
        build: Builds the fit of a copy of the hand model that has one shape.
        objective: The loss of these fits, with the hand model.
        descent: Settings of the optimizer.
        hands: Hands of the person, of `hands_of_person` if there are many.
        sigma_at_half_confidence: σ at confidence ½, pixels of a 224-pixel crop.

    Returns:
        The fit; without two usable hands, that of any hand.

    Raises:
        ValueError: The hands are not fitted, but a lifter's predictions.
    """
    if len(hands) < 2:
        return fitter
    shape = shape_of_person(
        fitter, objective, descent, hands, sigma_at_half_confidence=sigma_at_half_confidence
    )
    logger.info(
        "The hands are taken for one person's and share a shape, %.1f standard deviations from the mean, "
        "estimated from %d of them.", float(shape.norm()), len(hands),
    )  # fmt: skip
    of_person = build(objective.hand.of_shape(shape))

    def run(part: HandBatch) -> Fitted:
        return with_shape(of_person(part), shape, objective.prior)

    return run


def shape_of_person(
    fitter: Fitter,
    objective: Objective,
    descent: Descent,
    hands: HandBatch,
    *,
    sigma_at_half_confidence: float = SIGMA_AT_HALF_CONFIDENCE,
) -> Float[Tensor, " direction=10"]:
    """Estimate the one shape of some hands, standard deviations; arguments as of `one_person_fitter`.

    Raises:
        ValueError: The hands are not fitted, but a lifter's predictions.
    """
    found = _fitted(fitter, hands)
    seen = observed(hands, sigma_at_half_confidence)
    last = replace(objective, data_term=last_stage(objective.data_term, seen, descent))
    return shared_shape(seen, found, last)


def hands_of_person(landmarks: ImageLandmarks, most: int = MOST) -> HandBatch:
    """Hands with enough landmarks, spread evenly over all, in crops of 224 pixels.

    Args:
        landmarks: The hands of a person.
        most: Most hands that are taken.
    """
    usable = landmarks.usable.nonzero()[:, 0]
    step = max(1, -(-len(usable) // most))
    return to_crops(landmarks.select(usable[::step])).batch


def _fitted(fitter: Fitter, batch: HandBatch) -> HandParameters:
    """Fit hands one by one in parts."""
    parts = []
    for first in range(0, len(batch), PART):
        found = fitter(batch.select(slice(first, first + PART)))
        if not found.loss:
            raise ValueError(
                "same_person=true with descent.steps=0: a lifter's predictions share no shape. Fit with "
                "descent.steps=300, or leave same_person out."
            )
        parts.append(found.prediction.parameters)
    return HandParameters.join(parts)
