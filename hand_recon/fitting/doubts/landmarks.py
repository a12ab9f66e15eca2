"""Checks of the given landmarks: number, extent, spread, σ, and their order (decision 59)."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.doubts.reasons import Reasons, extents, reasons
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.hand.landmark_order import bone_sums

FEW_LANDMARKS: Final = 8
"""Number of given landmarks below which most of the pose is the prior's."""

SMALLEST_EXTENT: Final = 4.0
"""Least extent of a hand, pixels; smaller coordinates are shares of the image's size."""

THINNEST: Final = 0.05
"""Least spread of landmarks across their longest direction, as a share of the spread along it."""

GREATEST_SIGMA: Final = 8.0
"""Greatest median σ of a hand's landmarks, percent of the extent."""

SHORTER_BONES: Final = 0.85
"""Ratio of bone lengths in the image, another order to the given one, below which the order is named."""


def landmark_doubts(hands: FittedHands) -> dict[str, Reasons]:
    """Check the number, extent and σ of the landmarks, and that they are not on a line."""
    observed, extent = hands.observed, extents(hands)
    labelled = observed.labelled.sum(dim=1)
    thickness = _thickness(observed.landmarks_2d, observed.labelled)
    sigma = hands.prediction.log_sigma.exp().mean(dim=-1)
    sigma = 100 * sigma.masked_fill(~observed.labelled, torch.nan) / extent[:, None]
    sigma = sigma.nanmedian(dim=1).values
    return {
        "few landmarks": reasons(
            labelled < FEW_LANDMARKS,
            lambda hand: (
                f"Only {int(labelled[hand])} landmarks are given, and below {FEW_LANDMARKS} most of the pose "
                "is the prior's: give more landmarks."
            ),
        ),
        "small extent": reasons(
            extent < SMALLEST_EXTENT,
            lambda hand: (
                f"The landmarks span {float(extent[hand]):.2g} pixels, expected {SMALLEST_EXTENT:.0f} or "
                "more: give pixels of the image, no shares of its size."
            ),
        ),
        "line": reasons(
            thickness < THINNEST,
            lambda hand: (
                f"The landmarks are on a line: they spread {100 * float(thickness[hand]):.1f} % as far "
                f"across it as along it, expected {100 * THINNEST:.0f} % or more: check the coordinates."
            ),
        ),
        "sigma": reasons(
            sigma > GREATEST_SIGMA,
            lambda hand: (
                f"The landmarks' σ is {float(sigma[hand]):.0f} % of the hand's extent, expected below "
                f"{GREATEST_SIGMA:.0f} %. If it is a detector's, the detector is unsure of this hand: look "
                "at it. If it is the file's, check that the third values are confidences or σ in pixels, "
                "not depths."
            ),
        ),
    }


def _thickness(
    points: Float[Tensor, "hand landmark=21 2"], labelled: Bool[Tensor, "hand landmark=21"]
) -> Float[Tensor, " hand"]:
    """Spread of labelled points across their longest direction, as a share of the spread along it."""
    weight = labelled[..., None].to(points)
    points = torch.where(labelled[..., None], points, 0.0)
    middle = points.sum(dim=1, keepdim=True) / weight.sum(dim=1, keepdim=True).clamp(min=1)
    centred = (points - middle) * weight
    across, along = torch.linalg.eigvalsh(centred.mT @ centred).clamp(min=0).unbind(dim=-1)
    return (across / along).sqrt()


def order_doubts(hands: FittedHands, suspects: Iterable[int]) -> dict[str, Reasons]:
    """Name another landmark order for hands that fit badly, if bones are much shorter in it.

    Args:
        hands: All hands.
        suspects: Positions of the hands that fit badly; alone, short bones are no evidence, since those of
            a fist may be shorter in a wrong order.
    """
    found: Reasons = {}
    points = hands.observed.landmarks_2d.masked_fill(
        ~hands.observed.labelled[..., None], torch.nan
    ).numpy()
    for hand in suspects:
        sums = bone_sums(points[hand : hand + 1])
        if not len(sums["freihand"]):
            continue
        best = min(sums, key=lambda order: float(sums[order][0]))
        ratio = float(np.divide(sums[best], sums["freihand"])[0])
        if ratio < SHORTER_BONES:
            found[hand] = (
                f"The bones in the image are {100 - 100 * ratio:.0f} % shorter if the landmarks are taken in "
                f"the order {best}: check the order, or set order={best}."
            )
    return {"order": found}
