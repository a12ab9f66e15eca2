"""Checks of the residuals of a fit: mean, worst landmark, fingers out of line (decision 59).

Residuals are in percent of the hand's extent, the longer side of the box of its landmarks, so that limits
hold for images of any size.
"""

from itertools import permutations
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.doubts.reasons import Reasons, extents, reasons
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.hand.skeleton import FINGERS, LANDMARKS

USUAL_SIGMA: Final = 2.0
"""σ up to which a residual counts in full, percent of the extent: 3 pixels of a 224-pixel crop."""

MEAN_RESIDUAL: Final = 7.0
"""Greatest mean residual, percent of the extent."""

WORST_RESIDUAL: Final = 23.0
"""Greatest residual of one landmark, percent of the extent."""

OUTLIER: Final = (12.0, 6.0)
"""Residual of an outlier, percent of the extent, and its ratio to the mean of the other landmarks; a landmark
beyond both is doubtful."""

KNUCKLES: Final = (1, 5, 9, 13, 17)
"""Landmark at the base of each finger, thumb first."""

SHORTER_KNUCKLES: Final = 0.8
"""Ratio of the line through the knuckles, fingers exchanged to fingers as given, below which it counts."""

WITH_KNUCKLES: Final = (4.0, 3.0)
"""Mean residual in percent and shape in standard deviations, one of which a hand with such knuckles has."""


def relative_residuals(hands: FittedHands) -> Float[Tensor, "hand landmark=21"]:
    """Distance of each projection to its landmark, percent of the extent; NaN where none is given.

    Where σ is above `USUAL_SIGMA`, the distance is divided by their ratio: an uncertain landmark may be
    farther from its projection.
    """
    share = 100 / extents(hands)[:, None]
    sigma = share * hands.prediction.log_sigma.exp().mean(dim=-1)
    return share * hands.distance / (sigma / USUAL_SIGMA).clamp(min=1)


def residual_doubts(hands: FittedHands) -> dict[str, Reasons]:
    """Check the residuals: their mean, the worst landmark, and fingers that are out of line."""
    residuals = relative_residuals(hands)
    mean = residuals.nanmean(dim=1)
    worst, which = residuals.nan_to_num(0.0).max(dim=1)
    given = residuals.isfinite().sum(dim=1)
    others = (mean * given - worst) / (given - 1).clamp(min=1)
    least, ratio = OUTLIER
    is_outlier = (worst > least) & (worst > ratio * others)
    return {
        "mean residual": reasons(
            mean > MEAN_RESIDUAL,
            lambda hand: (
                f"The projections are {float(mean[hand]):.1f} % of the hand's extent from the landmarks on "
                f"average, expected below {MEAN_RESIDUAL:.0f} %: check the order of the landmarks, and that "
                "they are u, v in pixels of the image."
            ),
        ),
        "one landmark": reasons(
            (worst > WORST_RESIDUAL) | is_outlier,
            lambda hand: (
                f"The {LANDMARKS[int(which[hand])]} is {float(worst[hand]):.0f} % of the hand's extent from "
                f"its projection, expected below {WORST_RESIDUAL:.0f} %, and below {least:.0f} % where the "
                "other landmarks fit: check it, and write null for a landmark that was not found."
            ),
        ),
        "knuckles": _knuckle_doubts(hands, mean),
    }


def _knuckle_doubts(hands: FittedHands, mean: Float[Tensor, " hand"]) -> Reasons:
    """Find hands that fit badly, and whose knuckles are out of line unless fingers are exchanged."""
    residual, shape = WITH_KNUCKLES
    poor = (mean > residual) | (hands.prediction.parameters.shape.abs().amax(dim=1) > shape)
    # A line is as long from its other end: one direction of each order.
    orders = torch.tensor([order for order in permutations(range(5)) if order[0] < order[-1]])
    knuckles = hands.observed.landmarks_2d[:, list(KNUCKLES)]
    line = knuckles[:, orders].diff(dim=2).norm(dim=-1).sum(dim=-1)
    best, which = line.nan_to_num(torch.inf).min(dim=1)
    ratio = best / line[:, 0]

    def sentence(hand: int) -> str:
        order = ", ".join(FINGERS[finger] for finger in orders[which[hand]].tolist())
        return (
            f"The line through the bases of the fingers is {100 - 100 * float(ratio[hand]):.0f} % shorter in "
            f"the order {order}: check that no fingers are exchanged."
        )

    return reasons(poor & (ratio < SHORTER_KNUCKLES), sentence)
