"""Checks of camera matrices against the images and the landmarks that they are for (decision 58)."""

import logging
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

logger = logging.getLogger(__name__)

LARGEST_SHARE: Final = 20.0
"""Largest focal length of a matrix that was divided by the image's size."""

MIDDLE: Final = (0.2, 0.8)
"""Range of a principal point over the image's size, in whole images."""

SQUARE: Final = 1.1
"""Largest ratio of the focal lengths along the two axes, in pixels."""

WIDEST: Final = 1.75
"""Largest distance of a hand from the principal point, over the focal length: the tangent of 60°."""

Matrices = Float[np.ndarray, "hand 3 3"]
Sizes = Float[np.ndarray, "hand 2"]


def are_shares(matrices: Matrices) -> Bool[np.ndarray, " hand"]:
    """Mask of the matrices that were divided by the image's size."""
    focal, middle = _focal(matrices), matrices[:, :2, 2]
    small = (focal > 0).all(axis=1) & (focal < LARGEST_SHARE).all(axis=1)
    return np.asarray(small & (np.abs(middle) <= 1).all(axis=1))


def in_pixels(path: Path, matrices: Matrices, sizes: Sizes) -> Matrices:
    """Camera matrices in pixels; those that were divided by the image's size are multiplied by it.

    Args:
        path: Their file, for messages.
        matrices: One for each hand.
        sizes: Width and height of each hand's image, pixels; NaN where unknown.

    Raises:
        ValueError: A matrix was divided by an unknown size, or is not in pixels after multiplication.
    """
    shares = are_shares(matrices)
    if not shares.any():
        return matrices
    first = matrices[shares][0]
    found = (
        f"{path}: camera matrices with fx = {first[0, 0]:.4g}, fy = {first[1, 1]:.4g} and the principal "
        f"point ({first[0, 2]:.4g}, {first[1, 2]:.4g}) look to be divided by the image's size: they have "
        "focal lengths of a pixel or less, or of a few pixels"
    )
    if np.isnan(sizes[shares]).any():
        raise ValueError(
            f"{found}. The image's size is not known. Expected are pixels: multiply the first row by the "
            "image's width and the second by its height, or add image_size: [width, height] to the camera's "
            "file."
        )
    larger = matrices.copy()
    larger[shares, :2] *= sizes[shares][:, :, None]
    focal = _focal(larger[shares])
    if (focal.max(axis=1) > SQUARE * focal.min(axis=1)).any():
        raise ValueError(
            f"{found}, but multiplied by {sizes[shares][0, 0]:g} × {sizes[shares][0, 1]:g} the focal lengths "
            f"are {focal[0, 0]:.4g} and {focal[0, 1]:.4g}, which differ. Give the matrix in pixels."
        )
    logger.warning(
        "%s. They are multiplied by it: fx = %.5g, fy = %.5g and the principal point (%.5g, %.5g).",
        found, *larger[shares][0][[0, 1, 0, 1], [0, 1, 2, 2]],
    )  # fmt: skip
    return larger


def warn_of_cameras(
    path: Path, matrices: Matrices, points: Float[np.ndarray, "hand landmark=21 2"], sizes: Sizes
) -> None:
    """Warn of principal points far from the middle of the image, or of hands far outside the field of view.

    Args:
        path: The camera's file, for messages.
        matrices: Camera matrices, pixels.
        points: Landmarks, pixels; NaN where missing.
        sizes: Width and height of the images, pixels; NaN where unknown.
    """
    place = matrices[:, :2, 2] / sizes
    beside = ((place < MIDDLE[0]) | (place > MIDDLE[1])).any(axis=1)
    if beside.any():
        hand = int(np.flatnonzero(beside)[0])
        logger.warning(
            "%s: the principal point (%.5g, %.5g) is far from the middle of the image of %g × %g pixels (%d "
            "of %d hands). Is the matrix of an image of another size, or the image a part of a larger one? "
            "Then correct the matrix; depths and positions depend on it.",
            path, *matrices[hand, :2, 2], *sizes[hand], int(beside.sum()), len(beside),
        )  # fmt: skip
        return
    middle = np.nanmean(np.where(_some(points), points, 0.0), axis=1)
    off = np.abs(middle - matrices[:, :2, 2]) / _focal(matrices)
    outside = (off > WIDEST).any(axis=1) & _some(points)[:, 0, 0]
    if outside.any():
        hand = int(np.flatnonzero(outside)[0])
        logger.warning(
            "%s: %d of %d hands are more than 60° from the camera's axis; the first is at (%.4g, %.4g) with "
            "the principal point (%.4g, %.4g) and fx = %.4g. Is the matrix of another image size, or are the "
            "landmarks those of a crop? Depths and positions depend on it.",
            path, int(outside.sum()), len(outside), *middle[hand], *matrices[hand, :2, 2],
            matrices[hand, 0, 0],
        )  # fmt: skip


def _some(points: Float[np.ndarray, "hand landmark=21 2"]) -> Bool[np.ndarray, "hand 1 1"]:
    """Mask of the hands with a landmark."""
    return np.asarray(np.isfinite(points).any(axis=(1, 2), keepdims=True))


def _focal(matrices: Matrices) -> Float[np.ndarray, "hand 2"]:
    return np.asarray(matrices[:, [0, 1], [0, 1]])
