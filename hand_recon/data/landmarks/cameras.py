"""Gives landmarks the cameras of a file: image size, lens distortion and plausibility (decision 58)."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from hand_recon.data.landmarks.camera_checks import in_pixels, warn_of_cameras
from hand_recon.data.landmarks.camera_files import CameraFile, read_camera_file
from hand_recon.data.landmarks.distortion import undistorted
from hand_recon.data.landmarks.image_bounds import warn_of_hands_outside
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.image_sizes import sizes_of_images

logger = logging.getLogger(__name__)

ASPECT: Final = 0.01
"""Largest relative difference of two images' aspects that counts as the same."""


def with_cameras(landmarks: ImageLandmarks, path: Path) -> ImageLandmarks:
    """Landmarks with the camera matrices of a file, in pixels of their images and without lens distortion.

    A matrix divided by the image's size is multiplied by it; one of another image size of the same aspect is
    scaled; landmarks are undistorted where the file has distortion coefficients. Each is logged.

    Args:
        landmarks: Hands of any images; cameras that they have are replaced.
        path: The camera's file (`hand_recon.data.landmarks.camera_files`).

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It holds no cameras, another number of them, or they do not belong to these images.
    """
    hands = len(landmarks)
    file = read_camera_file(path, hands)
    which = np.arange(hands) if len(file.matrices) == hands else np.zeros(hands, dtype=np.int64)
    return with_camera_of(landmarks, path, file, which)


def with_camera_of(
    landmarks: ImageLandmarks, path: Path, file: CameraFile, which: Int[np.ndarray, " hand"]
) -> ImageLandmarks:
    """The same with cameras that were read before.

    Args:
        landmarks: Hands of any images; cameras that they have are replaced.
        path: The camera's file, for messages.
        file: Its cameras.
        which: Index of each hand's camera.

    Raises:
        ValueError: The cameras do not belong to these images.
    """
    hands = len(landmarks)
    calibrated = file.image_sizes[which]
    given = None if landmarks.image_sizes is None else landmarks.image_sizes.numpy()
    sizes = sizes_of_images(landmarks.images, given, hands)
    matrices = in_pixels(
        path, file.matrices[which], np.where(np.isnan(calibrated), sizes, calibrated)
    )
    matrices = _of_image_size(path, matrices, calibrated, sizes)
    points = landmarks.landmarks_2d.numpy().copy()
    labelled = landmarks.labelled.numpy()
    shown = np.where(np.isnan(sizes), calibrated, sizes)
    warn_of_cameras(path, matrices, points, shown)
    # Where the landmarks' own image is known, it was compared when they were read.
    warn_of_hands_outside(path, points, np.where(np.isnan(sizes), calibrated, np.nan))
    _undistort(path, (points, labelled), matrices, (file, which))
    return replace(
        landmarks,
        landmarks_2d=torch.from_numpy(points),
        intrinsics=torch.from_numpy(matrices),
    )


def _of_image_size(
    path: Path,
    matrices: Float[np.ndarray, "hand 3 3"],
    calibrated: Float[np.ndarray, "hand 2"],
    sizes: Float[np.ndarray, "hand 2"],
) -> Float[np.ndarray, "hand 3 3"]:
    """Matrices scaled from the image size of the calibration to that of the landmarks.

    Raises:
        ValueError: The two have different aspects.
    """
    factors = sizes / calibrated
    other = (np.abs(factors - 1) > 1e-9).any(axis=1)
    if not other.any():
        return matrices
    hand = int(np.flatnonzero(other)[0])
    found = (
        f"{path}: the camera matrix is of an image of {calibrated[hand, 0]:g} × {calibrated[hand, 1]:g} "
        f"pixels, and the landmarks are of one of {sizes[hand, 0]:g} × {sizes[hand, 1]:g}"
    )
    if (np.abs(factors[other, 0] / factors[other, 1] - 1) > ASPECT).any():
        raise ValueError(
            f"{found}, with another aspect: it is rotated or a part of the former. Give the matrix of the "
            "image that the landmarks are in."
        )
    logger.warning("%s; it is scaled by %.4g.", found, factors[hand, 0])
    scaled = matrices.copy()
    scaled[other, :2] *= factors[other][:, :, None]
    return scaled


def _undistort(
    path: Path,
    labels: tuple[Float[np.ndarray, "hand landmark=21 2"], Bool[np.ndarray, "hand landmark=21"]],
    matrices: Float[np.ndarray, "hand 3 3"],
    cameras: tuple[CameraFile, np.ndarray],
) -> None:
    """Undistort labelled landmarks in place, and log by how much."""
    points, labelled = labels
    file, which = cameras
    distances = []
    for hand, camera in enumerate(which):
        there = labelled[hand]
        if not (file.distortion[camera] or file.fisheye[camera]) or not there.any():
            continue
        straight = undistorted(
            path, points[hand, there], matrices[hand], file.distortion[camera], file.fisheye[camera]
        )
        distances.append(np.linalg.norm(straight - points[hand, there], axis=1))
        points[hand, there] = straight
    if distances:
        moved = np.concatenate(distances)
        logger.warning(
            "%s: the camera has lens distortion, which is removed from %d landmarks (%.3g pixels in the "
            "mean, %.3g at most). The results are in pixels of the undistorted image, as of cv2.undistort "
            "with the same matrix, so that drawings on the original image are off by as much.",
            path, len(moved), moved.mean(), moved.max(),
        )  # fmt: skip
