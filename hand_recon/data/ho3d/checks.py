"""Checks that HO3D's landmarks have the expected axes, order and unit, and names what was found instead.

A dataset with wrong axes, order or unit trains without an error and gives wrong results.
"""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.hand.landmark_order import better_order
from hand_recon.hand.skeleton import ROOT_LANDMARK, landmark_permutation

PROBES: Final = 1000
"""Number of frames whose bones are measured."""

PALM_LENGTHS: Final = (0.04, 0.2)
"""Possible medians of the distance from wrist to middle MCP, metres; adults' hands have 0.1."""


def check_landmarks(
    path: Path,
    landmarks: Float[np.ndarray, "frame landmark=21 3"],
    names: list[str],
) -> None:
    """Refuse landmarks with another order, other axes or another unit than HO3D's.

    Args:
        path: Where they come from, for messages.
        landmarks: Landmarks converted from HO3D's format to FreiHAND's order, OpenCV's axes and metres.
        names: Names of the frames.

    Raises:
        ValueError: They are behind the camera, in another order or unit.
    """
    if not len(landmarks):
        return
    _check_axes(path, landmarks, names)
    some = landmarks[:: max(1, len(landmarks) // PROBES)]
    _check_order(path, some)
    palm = float(np.median(np.linalg.norm(some[:, ROOT_LANDMARK] - some[:, 0], axis=-1)))
    if not PALM_LENGTHS[0] < palm < PALM_LENGTHS[1]:
        raise ValueError(
            f"{path}: from the wrist to the middle finger's MCP it is {palm:.4g} in the median, expected "
            "about 0.1: the unit must be metres."
        )


def check_wrists_inside(
    path: Path,
    wrists: Float[np.ndarray, "frame 2"],
    size: tuple[int, int],
) -> None:
    """Refuse camera matrices that do not belong to the images.

    Args:
        path: Where the cameras come from, for messages.
        wrists: Projections of the wrists, pixels.
        size: Width and height of the images.

    Raises:
        ValueError: Most wrists are outside.
    """
    outside = np.any((wrists < 0) | (wrists > np.array(size)), axis=-1)
    if outside.mean() > 0.5:
        raise ValueError(
            f"{path}: {int(outside.sum())} of {len(outside)} wrists project outside their images of "
            f"{size[0]} × {size[1]} pixels. The camera matrices (camMat) must be those of the images as "
            "they are on the disk: do not resize them."
        )


def _check_axes(
    path: Path, landmarks: Float[np.ndarray, "frame landmark=21 3"], names: list[str]
) -> None:
    behind = np.any(landmarks[..., 2] <= 0, axis=1)
    if not behind.any():
        return
    if np.median(landmarks[..., 2]) < 0:
        raise ValueError(
            f"{path}: {int(behind.sum())} of {len(behind)} hands are behind the camera after y and z "
            "were negated, as HO3D's OpenGL axes need. If they are in OpenCV's axes (z > 0) already, "
            "multiply y and z by −1: this loader expects HO3D's own."
        )
    first = ", ".join(names[row] for row in np.flatnonzero(behind)[:5])
    raise ValueError(
        f"{path}: {int(behind.sum())} of {len(behind)} hands have landmarks behind the camera; the first are "
        f"{first}. Remove them from the list of frames."
    )


def _check_order(path: Path, landmarks: Float[np.ndarray, "frame landmark=21 3"]) -> None:
    in_file = landmarks[:, list(landmark_permutation("freihand", "ho3d"))]
    order = better_order(in_file, "ho3d")
    if order is not None:
        raise ValueError(
            f"{path}: the landmarks are not in HO3D's order but seem to be in that of {order!r}, "
            "in which bones are shorter. Reorder them by "
            f"landmarks[{list(landmark_permutation(order, 'ho3d'))}]."
        )
