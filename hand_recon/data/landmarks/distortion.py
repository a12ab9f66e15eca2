"""Removes lens distortion from landmarks (decision 58)."""

from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import Float

COUNTS: Final = (4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's model; fewer than four are filled with zeros."""

FISHEYE_COUNT: Final = 4
"""Number of coefficients of OpenCV's fisheye model."""

LARGEST_DIFFERENCE: Final = 0.5
"""Largest distance of a landmark from its undistorted position distorted again, pixels."""

STEPS: Final = 20
"""Steps of Newton's method from OpenCV's solution, whose five steps leave pixels of error at wide angles."""

STEP: Final = 1e-6
"""Step of the finite differences, in units of the focal length."""


def undistorted(
    path: Path,
    points: Float[np.ndarray, "landmark 2"],
    matrix: Float[np.ndarray, "3 3"],
    coefficients: tuple[float, ...],
    fisheye: bool,
) -> Float[np.ndarray, "landmark 2"]:
    """Positions of landmarks in the image of a camera with the same matrix and no distortion.

    Args:
        path: The camera file, for messages.
        points: Pixels, finite.
        matrix: Camera matrix, pixels.
        coefficients: Those of OpenCV's model, or of its fisheye model.
        fisheye: True for the latter.

    Raises:
        ValueError: The number of coefficients is unknown, or the model has no inverse at a landmark.
    """
    factors = _filled(path, coefficients, fisheye)
    homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    seen = np.ascontiguousarray((homogeneous @ np.linalg.inv(matrix).T)[:, :2])
    straight = _first_guess(seen, factors, fisheye)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            straight = straight + _newton_step(straight, seen, factors, fisheye)[0]
        _, determinant = _newton_step(straight, seen, factors, fisheye)
        difference = (_distorted(straight, factors, fisheye) - seen) * np.diag(matrix)[:2]
    # A negative determinant is a second solution, beyond the fold of the model.
    wrong = ~((np.abs(difference).max(axis=1) <= LARGEST_DIFFERENCE) & (determinant > 0))
    if wrong.any():
        raise ValueError(
            f"{path}: the lens distortion {list(coefficients)} cannot be removed at {int(wrong.sum())} of "
            f"{len(points)} landmarks, which lie where the model has no inverse. Is it of another camera or "
            "image size? Undistort the landmarks yourself and leave the coefficients out, or correct them."
        )
    homogeneous = np.concatenate([straight, np.ones((len(points), 1))], axis=1)
    return np.asarray(homogeneous @ matrix[:2].T)


def _filled(
    path: Path, coefficients: tuple[float, ...], fisheye: bool
) -> Float[np.ndarray, " coefficient"]:
    factors = np.array(coefficients, dtype=np.float64)
    if len(factors) < FISHEYE_COUNT:
        factors = np.concatenate([factors, np.zeros(FISHEYE_COUNT - len(factors))])
    counts = (FISHEYE_COUNT,) if fisheye else COUNTS
    if len(factors) not in counts:
        raise ValueError(
            f"{path}: {len(factors)} distortion coefficients; expected {' or '.join(map(str, counts))} in "
            f"OpenCV's order ({'k1 to k4' if fisheye else 'k1, k2, p1, p2, k3, …'})."
        )
    return factors


def _first_guess(
    seen: Float[np.ndarray, "landmark 2"], factors: np.ndarray, fisheye: bool
) -> Float[np.ndarray, "landmark 2"]:
    if fisheye:
        found = cv2.fisheye.undistortPoints(seen[:, None], np.eye(3), factors)
    else:
        found = cv2.undistortPoints(seen[:, None], np.eye(3), factors)
    guess = np.asarray(found, dtype=np.float64).reshape(-1, 2)
    return np.where(np.isfinite(guess) & (np.abs(guess) < 1e3), guess, seen)


def _newton_step(
    straight: Float[np.ndarray, "landmark 2"],
    seen: Float[np.ndarray, "landmark 2"],
    factors: np.ndarray,
    fisheye: bool,
) -> tuple[Float[np.ndarray, "landmark 2"], Float[np.ndarray, " landmark"]]:
    """Step towards the position whose image is seen, and the determinant of the Jacobian."""
    here = _distorted(straight, factors, fisheye)
    along_x, along_y = (
        (_distorted(straight + STEP * axis, factors, fisheye) - here) / STEP for axis in np.eye(2)
    )
    determinant = along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0]
    left = seen - here
    across = along_y[:, 1] * left[:, 0] - along_y[:, 0] * left[:, 1]
    down = along_x[:, 0] * left[:, 1] - along_x[:, 1] * left[:, 0]
    step = np.stack([across, down], axis=-1) / determinant[:, None]
    return np.where(np.isfinite(step), step, 0.0), determinant


def _distorted(
    straight: Float[np.ndarray, "landmark 2"], factors: np.ndarray, fisheye: bool
) -> Float[np.ndarray, "landmark 2"]:
    """Image of rays (x, y, 1) with distortion, at unit focal length."""
    if fisheye:
        bent = cv2.fisheye.distortPoints(straight[:, None], np.eye(3), factors)
        return np.asarray(bent, dtype=np.float64).reshape(-1, 2)
    rays = np.concatenate([straight, np.ones((len(straight), 1))], axis=1)
    bent, _ = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), np.eye(3), factors)
    return np.asarray(bent, dtype=np.float64).reshape(-1, 2)
