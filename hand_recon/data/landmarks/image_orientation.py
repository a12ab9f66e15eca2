"""Converts landmarks of images as stored to the upright images that are read (decision 58).

A camera held upright stores the image lying and its EXIF orientation beside it. Images are read upright
everywhere; some annotation tools show them as stored.
"""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float

from hand_recon.camera import move_points
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.image_sizes import stored_size, upright_size

logger = logging.getLogger(__name__)

ROTATIONS: Final = {6: ((0.0, -1.0), (1.0, 0.0)), 8: ((0.0, 1.0), (-1.0, 0.0))}
"""Linear part of the map from stored to upright pixels, by EXIF's orientation."""

MIRRORED: Final = (5, 7)
"""Orientations that exchange width and height and mirror the image."""


@dataclass(frozen=True)
class _Rasters:
    """Comparison of each hand's image on the disk with the size in the landmark file."""

    stored: Float[np.ndarray, "hand 2"]
    """Width and height as stored, pixels; NaN where there is no image or no size in the file."""
    orientation: np.ndarray
    """EXIF's orientation of each image, 1 where it is unknown."""
    lying: Bool[np.ndarray, " hand"]
    """True for hands whose size in the file is that of the stored image, and not of the upright one."""
    other: Bool[np.ndarray, " hand"]
    """True for hands whose size in the file is neither."""


def upright_without_camera(landmarks: ImageLandmarks, where: Path) -> ImageLandmarks:
    """Landmarks in pixels of the upright images (`to_upright`), unless their cameras are known.

    With cameras, they stay in the frame of the cameras, which the results are in, with a warning. Sizes that
    are those of other images are warned of.

    Args:
        landmarks: Landmarks of any hands.
        where: Their file, for messages.

    Raises:
        ValueError: A stored image is mirrored.
    """
    if landmarks.image_sizes is None:
        return landmarks
    if landmarks.intrinsics is None:
        return to_upright(landmarks, where, strict=False)
    lying = _compare(landmarks).lying
    if lying.any():
        logger.warning(
            "%s: %d of %d hands are in pixels of images as they are stored, which EXIF's orientation rotates "
            "by 90°. As their cameras are given, the results of a fit stay in that frame, and drawings on "
            "these images are rotated.",
            where, int(lying.sum()), len(landmarks),
        )  # fmt: skip
    return landmarks


def to_upright(landmarks: ImageLandmarks, where: Path, strict: bool = True) -> ImageLandmarks:
    """Landmarks in pixels of the upright images, where the sizes in their file are those of stored images.

    Hands without an image or without a size in the file stay as they are.

    Args:
        landmarks: Landmarks of any hands.
        where: Their file or folder, for messages.
        strict: Refuse files most of whose sizes are not those of the images; else this is only logged.

    Raises:
        ValueError: Most sizes in the file are not those of the images, or a stored image is mirrored.
    """
    if landmarks.image_sizes is None:
        return landmarks
    rasters = _compare(landmarks)
    _refuse_other_sizes(landmarks, rasters, where, strict)
    if not rasters.lying.any():
        return landmarks
    mirrored = rasters.lying & np.isin(rasters.orientation, MIRRORED)
    if mirrored.any():
        hand = int(np.flatnonzero(mirrored)[0])
        raise ValueError(
            f"{where}: {int(mirrored.sum())} hands are labelled in images that are stored mirrored (EXIF "
            f"orientation {rasters.orientation[hand]}, {landmarks.images[hand]}), so that their sides are "
            "uncertain. Save these images upright, and label them again."
        )
    logger.warning(
        "%s: the labels of %d of %d hands are in pixels of images as they are stored, which EXIF's "
        "orientation rotates by 90°: the file gives their size as %g × %g, the upright image is %g × %g. "
        "They are rotated with the images; the first is %s.",
        where, int(rasters.lying.sum()), len(landmarks), *rasters.stored[rasters.lying][0],
        *rasters.stored[rasters.lying][0][::-1], landmarks.images[int(np.flatnonzero(rasters.lying)[0])],
    )  # fmt: skip
    return _rotated(landmarks, rasters)


def _compare(landmarks: ImageLandmarks) -> _Rasters:
    hands = len(landmarks)
    stored, upright = np.full((hands, 2), np.nan), np.full((hands, 2), np.nan)
    orientation = np.ones(hands, dtype=np.int64)
    for hand, image in enumerate(landmarks.images):
        found = None if image is None else stored_size(image)
        if found is not None:
            stored[hand], upright[hand], orientation[hand] = (
                found[:2],
                upright_size(found),
                found[2],
            )
    given = np.full((hands, 2), np.nan)
    if landmarks.image_sizes is not None:
        given = landmarks.image_sizes.numpy()
    known = np.isfinite(given).all(axis=1) & np.isfinite(stored).all(axis=1)
    same = (given == upright).all(axis=1)
    lying = known & ~same & (given == stored).all(axis=1)
    return _Rasters(stored, orientation, lying, known & ~same & ~lying)


def _refuse_other_sizes(
    landmarks: ImageLandmarks, rasters: _Rasters, where: Path, strict: bool
) -> None:
    if not rasters.other.any() or landmarks.image_sizes is None:
        return
    hand = int(np.flatnonzero(rasters.other)[0])
    found = (
        f"{where}: for {int(rasters.other.sum())} of {len(landmarks)} hands the file gives another size than "
        "the image has; the first is {:g} × {:g} in the file and {:g} × {:g} on the disk ({})"
    ).format(*landmarks.image_sizes[hand].tolist(), *rasters.stored[hand], landmarks.images[hand])
    known = np.isfinite(rasters.stored).all(axis=1)
    if strict and 2 * rasters.other.sum() > known.sum():
        raise ValueError(
            f"{found}. Labels must be in pixels of the images as they are on the disk: scale the labels by "
            "the ratio of the sizes, use the images that were labelled, or correct `width` and `height`."
        )
    logger.warning("%s.", found)


def _rotated(landmarks: ImageLandmarks, rasters: _Rasters) -> ImageLandmarks:
    """Landmarks, boxes, cameras and sizes of the lying hands rotated with their images."""
    matrices = torch.eye(3, dtype=torch.float64).repeat(len(landmarks), 1, 1)
    cameras = matrices.clone()
    for hand in np.flatnonzero(rasters.lying):
        width, height = rasters.stored[hand]
        orientation = int(rasters.orientation[hand])
        rotation = torch.tensor(ROTATIONS[orientation], dtype=torch.float64)
        cameras[hand, :2, :2] = matrices[hand, :2, :2] = rotation
        offset = (height, 0.0) if orientation == 6 else (0.0, width)
        matrices[hand, :2, 2] = torch.tensor(offset, dtype=torch.float64)
    boxes, intrinsics, sizes = (
        landmarks.hand_boxes, landmarks.intrinsics, landmarks.image_sizes,
    )  # fmt: skip
    if boxes is not None:
        corners = move_points(boxes.unflatten(-1, (2, 2)), matrices)
        boxes = torch.cat([corners.amin(dim=1), corners.amax(dim=1)], dim=-1)
    lying = torch.from_numpy(rasters.lying)
    return replace(
        landmarks,
        landmarks_2d=move_points(landmarks.landmarks_2d, matrices),
        hand_boxes=boxes,
        # The camera is rotated about its axis, so that its matrix stays upper triangular.
        intrinsics=None if intrinsics is None else matrices @ intrinsics @ cameras.mT,
        image_sizes=None if sizes is None else torch.where(lying[:, None], sizes.flip(-1), sizes),
    )
