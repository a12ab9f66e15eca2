"""Recognition of 3D points that were given in place of 2D landmarks."""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

HAND: Final = (0.06, 0.45)
"""Smallest and largest diagonal of the box around a hand's 3D points, metres; adults have about 0.2."""

UNITS: Final = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001}
"""Metres per unit of 3D points."""

NEGATIVE: Final = 0.5
"""Least share of hands with a clearly negative x or y. Pixels are negative only outside of the image."""

DEPTH_SPREAD: Final = 0.05
"""Least depth of a hand over its diagonal, in the median hand."""

PROJECTION: Final = "uvw = xyz @ np.swapaxes(K, -1, -2); uv = uvw[..., :2] / uvw[..., 2:]"
"""NumPy statements that project 3D points with one camera matrix or one per hand."""


def refuse_points_in_space(
    path: Path,
    points: Float[np.ndarray, "hand landmark=21 2"],
    third_value: Float[np.ndarray, "hand landmark=21"] | None,
) -> None:
    """Raise an error if the points and their third values are 3D hands in metres, centimetres or millimetres.

    Args:
        path: The file, for the message.
        points: First two numbers of each landmark, NaN where missing.
        third_value: Third number of each landmark.

    Raises:
        ValueError: They are; the message names the unit and the projection.
    """
    if third_value is None:
        return
    every = np.concatenate([points, third_value[..., None]], axis=-1)
    hands = every[np.isfinite(every).all(axis=(1, 2))]
    unit = _unit(hands) if len(hands) else None
    if unit is None:
        return
    example = (
        " In FreiHAND, training_K.json holds K for training_xyz.json." if unit == "metres" else ""
    )
    raise ValueError(
        f"{path}: the numbers are 3D points in {unit} ({_median_size(hands):.3g} from corner to corner of a "
        f"hand's box in the median), and expected are 2D landmarks in pixels. {_cure(hands)}{example}"
    )


def _unit(hands: Float[np.ndarray, "hand landmark=21 3"]) -> str | None:
    """Unit of 3D hands; None if the numbers are pixels or shares of an image's size."""
    diagonal = _diagonals(hands)
    shown = hands[..., :2].min(axis=(1, 2)) < -0.05 * diagonal
    if shown.mean() < NEGATIVE:
        return None
    if np.median(np.ptp(hands[..., 2], axis=1) / np.maximum(diagonal, 1e-12)) < DEPTH_SPREAD:
        return None
    size = float(np.median(diagonal))
    fitting = [unit for unit, metres in UNITS.items() if HAND[0] <= size * metres <= HAND[1]]
    return fitting[0] if fitting and not _is_detector_depth(hands) else None


def _is_detector_depth(hands: Float[np.ndarray, "hand landmark=21 3"]) -> bool:
    """True if a landmark's third value is 0 in every hand where its position is not, as in MediaPipe's z."""
    scale = np.abs(hands[..., 2]).max(axis=1, keepdims=True)
    zero = (np.abs(hands[..., 2]) <= 1e-4 * scale).all(axis=0)
    away = (np.abs(hands[..., :2]).max(axis=-1) > 1e-4 * scale).all(axis=0)
    return bool((zero & away).any())


def _diagonals(hands: Float[np.ndarray, "hand landmark=21 3"]) -> Float[np.ndarray, " hand"]:
    return np.asarray(np.linalg.norm(np.ptp(hands, axis=1), axis=-1))


def _median_size(hands: Float[np.ndarray, "hand landmark=21 3"]) -> float:
    return float(np.median(_diagonals(hands)))


def _cure(hands: Float[np.ndarray, "hand landmark=21 3"]) -> str:
    depth = hands[..., 2]
    if (depth > 0).all():
        return f"Project them with the camera matrix K: {PROJECTION}."
    if (depth < 0).all():
        return (
            "All depths are negative, as in OpenGL's axes: negate y and z, then project the points with the "
            f"camera matrix K: {PROJECTION}."
        )
    return (
        "They are relative to a point of the hand: add that point's position in the camera's frame, then "
        f"project them with the camera matrix K: {PROJECTION}."
    )
