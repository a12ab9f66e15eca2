"""Which order landmarks are in, told from the landmarks: in the right one, bones are short.

Every convention numbers the 21 points otherwise (`hand_recon.hand.skeleton.LANDMARK_ORDERS`), and files do
not say which is theirs. Read in a wrong order, some bones cross the hand: the right order has the shortest
bones in sum. It works for points of an image as for points in space.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARK_PARENTS, landmark_permutation

MARGIN: Final = 0.98
"""Another order is believed if it shortens the bones to less than this. Two tips exchanged shorten them by
about 5 %, and the noise of detectors by nothing: it lengthens bones in every order."""

MAJORITY: Final = 0.75
"""Share of the hands whose bones it must shorten. Of fists in pictures, some are shorter in a wrong order."""

FEWEST: Final = 5
"""Hands without which nothing is said: one fist can look shorter in a wrong order."""


def bone_sums(
    points: Float[np.ndarray, "hand landmark=21 dimension"],
) -> dict[str, Float[np.ndarray, " whole"]]:
    """Sum of each hand's bones over its size, if the points were in each of the known orders.

    Args:
        points: In any unit; hands with a NaN, and those of no size, are left out.

    Returns:
        By name of the order.
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
    """The order that the points look to be in, if it is clearly not the assumed one.

    Args:
        points: In the assumed order, any unit; hands with a NaN are left out.
        assumed: A key of `LANDMARK_ORDERS`.

    Returns:
        A key of `LANDMARK_ORDERS`, or none if the assumed order may be right or there are too few hands.
    """
    sums = bone_sums(points)
    own = sums[assumed]
    if len(own) < FEWEST:
        return None
    best = min(sums, key=lambda order: float(sums[order].mean()))
    clearly = sums[best].mean() < MARGIN * own.mean()
    return best if clearly and (sums[best] < own).mean() >= MAJORITY else None
