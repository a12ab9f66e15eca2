"""Detection of the landmark convention of unlabelled points: the correct order has the shortest bones.

Each convention orders the 21 landmarks differently (`hand_recon.hand.skeleton.LANDMARK_ORDERS`), and files
do not say which one they follow. In a wrong order some bones cross the hand, so the correct order has the
smallest sum of bone lengths. This holds for 2D points and for 3D points.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARK_PARENTS, landmark_permutation

MARGIN: Final = 0.98
"""Largest ratio of bone lengths, best order to assumed order, at which the best one is reported. Correcting
two exchanged tips shortens the bones by about 5 %; detector noise lengthens them in every order."""

MAJORITY: Final = 0.75
"""Share of hands whose bones must be shorter in the reported order; a few fists in images are shorter in a
wrong order."""

FEWEST: Final = 5
"""Least number of hands for a result, because a single fist can be shorter in a wrong order."""


def bone_sums(
    points: Float[np.ndarray, "hand landmark=21 dimension"],
) -> dict[str, Float[np.ndarray, " whole"]]:
    """Sum of bone lengths over hand size, for each known order that the points could be in.

    Args:
        points: Any unit; hands that have a NaN or zero size are left out.

    Returns:
        One value per hand, by name of the order.
    """
    whole = points[np.isfinite(points).all(axis=(1, 2))].astype(np.float64)
    size = np.linalg.norm(np.ptp(whole, axis=1), axis=-1)
    whole = whole[size > 0] / size[size > 0, None, None]
    sums = {}
    for order in LANDMARK_ORDERS:
        ours = whole[:, landmark_permutation(order, "freihand")]
        bones = ours[:, 1:] - ours[:, list(LANDMARK_PARENTS[1:])]
        sums[order] = np.asarray(np.linalg.norm(bones, axis=-1).sum(axis=1))
    return sums


def better_order(
    points: Float[np.ndarray, "hand landmark=21 dimension"], assumed: str = "freihand"
) -> str | None:
    """Find the order with clearly shorter bones than the assumed one.

    Args:
        points: Any unit, presumed to be in the assumed order; hands that have a NaN are left out.
        assumed: A key of `LANDMARK_ORDERS`.

    Returns:
        A key of `LANDMARK_ORDERS`, or None if no order is clearly better or there are too few hands.
    """
    sums = bone_sums(points)
    own = sums[assumed]
    if len(own) < FEWEST:
        return None
    best = min(sums, key=lambda order: float(sums[order].mean()))
    clearly = sums[best].mean() < MARGIN * own.mean()
    return best if clearly and (sums[best] < own).mean() >= MAJORITY else None
