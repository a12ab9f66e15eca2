"""Images in the order in which labels of them help most: error bars, doubts, and what is unlike the others.

An image has the value of its worst hand: the root mean square of its landmarks' standard deviations, in
millimetres. Images are chosen one by one, by the value times the share that is new: a label of one image says
much about images in which the hand is posed and seen alike (decision 83).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.hand.skeleton import LANDMARKS, ROOT_LANDMARK

RANKINGS: Final = ("uncertainty",)
"""Values of `rank`."""

DOUBT: Final = 10.0
"""Added to the value of a doubtful hand, whose error bars cannot be trusted, millimetres."""

UNFITTED: Final = 30.0
"""Value of a hand that could not be fitted, millimetres."""

UNFOUND: Final = 15.0
"""Value of the first image without a hand, millimetres; of the n-th, 1/n of it: they may have none."""

ALIKE: Final = 0.12
"""Distance of two hands, in hand lengths, at which a label of one leaves 39 % of the other's value."""

_MM: Final = 1000.0


@dataclass(frozen=True)
class RankedImage:
    """An image of the list, with the reason for its place."""

    image: str
    """Name of the image."""
    value: float
    """Value of a label of it alone, millimetres."""
    gain: float
    """Rest of the value beside the images before it, millimetres."""
    reason: str
    """Sentence for the annotator."""


def ranked_images(hands: HandRecords, images: Sequence[str]) -> list[RankedImage]:
    """Sort images by how much a label of them would help, the first to annotate first.

    Args:
        hands: Reconstructed hands.
        images: Names of all images that could be read, also of those without a hand.
    """
    worst = _worst_hands(hands)
    values = np.array([_value(hands, worst.get(image)) for image in images], dtype=float)
    places = np.full((len(images), 63), np.nan)
    for row, image in enumerate(images):
        if image in worst:
            places[row] = _pose(hands, worst[image]).ravel()
    ranked = []
    for row, gain, like in _chosen(values, places):
        reason = _reason(hands, worst.get(images[row]))
        if like is not None:
            reason = f"{reason} Like {images[like]}, which is listed before."
        ranked.append(RankedImage(images[row], float(values[row]), gain, reason))
    return ranked


def _worst_hands(hands: HandRecords) -> dict[str, int]:
    """Hand of the largest value of each image."""
    worst: dict[str, int] = {}
    for hand, image in enumerate(hands.images):
        name = image or ""
        if name not in worst or _value(hands, hand) > _value(hands, worst[name]):
            worst[name] = hand
    return worst


def _value(hands: HandRecords, hand: int | None) -> float:
    """Value of a label of a hand, millimetres."""
    if hand is None:
        return UNFOUND
    if hands.verdicts[hand] == "not fitted":
        return UNFITTED
    sigma = _sigma(hands, hand)
    value = _mean_sigma(sigma) if np.isfinite(sigma).any() else UNFOUND
    return value + (DOUBT if hands.verdicts[hand] == "doubtful" else 0.0)


def _sigma(hands: HandRecords, hand: int) -> Float[np.ndarray, "landmark=21"]:
    """Standard deviation of each landmark along one axis, millimetres; NaN without an estimate.

    It is that of `covariance_3d`; without one, σ in the image at the hand's distance.
    """
    variance = hands.covariance_3d[hand].trace(axis1=-2, axis2=-1) / 3
    if np.isfinite(variance).any():
        return _MM * np.sqrt(variance)
    metres = hands.translation[hand, 2] / hands.intrinsics[hand, 0, 0]
    sigma: Float[np.ndarray, "landmark=21"] = np.sqrt(np.square(hands.sigma_2d[hand]).mean(axis=-1))
    return _MM * metres * sigma


def _pose(hands: HandRecords, hand: int) -> Float[np.ndarray, "landmark=21 3"]:
    """Landmarks from the root, in hand lengths and the camera's axes; left hands mirrored to right ones."""
    points = hands.landmarks_3d[hand] - hands.landmarks_3d[hand, ROOT_LANDMARK]
    points = points / np.linalg.norm(points, axis=-1).max()
    return points * np.array([-1.0 if hands.sides[hand] == "left" else 1.0, 1.0, 1.0])


def _chosen(
    values: Float[np.ndarray, " image"], places: Float[np.ndarray, "image 63"]
) -> list[tuple[int, float, int | None]]:
    """Choose images one by one: the image, its gain, and the chosen image that takes most of its value."""
    new = np.ones(len(values))
    like = np.full(len(values), -1)
    posed = np.isfinite(places).all(axis=1)
    left = np.ones(len(values), dtype=bool)
    blank, chosen = 1, []
    for _ in range(len(values)):
        gains = np.where(left, values * new, -np.inf)
        row = int(gains.argmax())
        chosen.append(
            (row, float(gains[row]), int(like[row]) if new[row] < 0.5 and posed[row] else None)
        )
        left[row] = False
        if posed[row]:
            share = _new_beside(places, row)
            closer = posed & (share < new)
            new[closer], like[closer] = share[closer], row
        else:
            # They cannot be compared, so that the n-th counts 1/n.
            blank += 1
            new[~posed] = 1 / blank
    return chosen


def _new_beside(places: Float[np.ndarray, "image 63"], row: int) -> Float[np.ndarray, " image"]:
    """Share of each image's value that a label of one of them leaves; NaN without a pose."""
    squared = np.square(places - places[row]).sum(axis=1) / len(LANDMARKS)
    return -np.expm1(-squared / (2 * ALIKE**2))


def _reason(hands: HandRecords, hand: int | None) -> str:
    """Sentence on the hand that gave an image its value."""
    if hand is None:
        return "No hand was found: label it if there is one."
    side = hands.sides[hand]
    if hands.verdicts[hand] == "not fitted":
        return f"The {side} hand could not be fitted: {' '.join(hands.reasons[hand])}"
    sigma = _sigma(hands, hand)
    words = f"The {side} hand has no error bars."
    if np.isfinite(sigma).any():
        most = int(np.nanargmax(sigma))
        words = (
            f"The {side} hand is uncertain by {_mean_sigma(sigma):.0f} mm, most at the "
            f"{LANDMARKS[most]} ({sigma[most]:.0f} mm)."
        )
    if hands.verdicts[hand] == "doubtful":
        words = f"{words} It is doubtful: {' '.join(hands.reasons[hand])}"
    return words


def _mean_sigma(sigma: Float[np.ndarray, "landmark=21"]) -> float:
    """Root mean square of the known standard deviations."""
    return math.sqrt(float(np.nanmean(np.square(sigma))))
