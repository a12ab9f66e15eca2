"""Fit of hands of one person, which share their shape (Sec. 3.4)."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import torch

from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.descent import Descent, last_stage
from hand_recon.fitting.in_parts import PART, Fitter
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import observed
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
    landmarks: ImageLandmarks,
    *,
    sigma_at_half_confidence: float,
) -> Fitter:
    """Estimate the shape of one person's hands, and build the fit of hands of this shape.

    Left hands mirror right ones and have the same shape.

    Args:
        fitter: Fit of the hand model, of any hands.
        build: Builds the fit of a copy of the hand model that has one shape.
        objective: The loss of these fits, with the hand model.
        descent: Settings of the optimizer.
        landmarks: The hands of the person.
        sigma_at_half_confidence: σ at confidence ½, pixels of a 224-pixel crop.

    Returns:
        The fit; without two usable hands, that of any hand.

    Raises:
        ValueError: The hands are not fitted, but a lifter's predictions.
    """
    some = _spread(landmarks)
    if len(some) < 2:
        return fitter
    batch = to_crops(some).batch
    found = _fitted(fitter, batch)
    seen = observed(batch, sigma_at_half_confidence)
    last = replace(objective, data_term=last_stage(objective.data_term, seen, descent))
    shape = shared_shape(seen, found, last)
    logger.info(
        "%d hands are taken for one person's and share a shape, %.1f standard deviations from the mean.",
        len(landmarks), float(shape.norm()),
    )  # fmt: skip
    of_person = build(objective.hand.of_shape(shape))

    def run(part: HandBatch) -> Fitted:
        return with_shape(of_person(part), shape, objective.prior)

    return run


def _spread(landmarks: ImageLandmarks) -> ImageLandmarks:
    """At most `MOST` hands with enough landmarks."""
    usable = landmarks.usable.nonzero()[:, 0]
    step = max(1, -(-len(usable) // MOST))
    return landmarks.select(usable[::step])


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
    return HandParameters(
        torch.cat([part.joint_angles for part in parts]),
        torch.cat([part.shape for part in parts]),
        torch.cat([part.root_rotation for part in parts]),
        torch.cat([part.translation for part in parts]),
    )
