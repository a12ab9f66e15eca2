"""Calibration of σ on a clip of one hand by two calibrated cameras, by the epipolar constraint.

A landmark in one image restricts the same landmark in the other to a line. The distance from it is the
landmarks' error, of both cameras, across the line; errors along the line and errors that both cameras share
are not seen.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float
from scipy.stats import spearmanr

from hand_recon.detection.landmark_noise import NoiseTable, combined_spread
from landmark_noise.readings import SQUARE, CopiedHand, Image, read_hands

Points = Float[np.ndarray, "frame landmark=21 2"]
Values = Float[np.ndarray, "frame landmark=21"]


@dataclass(frozen=True)
class Camera:
    """A calibrated camera."""

    matrix: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels."""
    distortion: Float[np.ndarray, " coefficient"]
    """OpenCV's distortion coefficients."""
    rotation: Float[np.ndarray, "3 3"]
    """Rotation from the world to the camera."""
    translation: Float[np.ndarray, "3"]
    """Translation from the world to the camera."""

    @classmethod
    def read(cls, values: dict[str, Any]) -> "Camera":
        """The camera of an entry of `calibration.json`."""
        return cls(*(np.array(values[key], dtype=float) for key in ("K", "distortion", "R", "t")))

    def undistorted(self, points: Points) -> Points:
        """Landmarks without the lens's distortion, pixels."""
        flat = cv2.undistortPoints(
            points.reshape(-1, 1, 2), self.matrix, self.distortion, P=self.matrix
        )
        return np.asarray(flat, dtype=np.float64).reshape(points.shape)


def fundamental_matrix(one: Camera, other: Camera) -> Float[np.ndarray, "3 3"]:
    """F with xᵀ F y = 0 for a point at y in one image and at x in the other."""
    rotation = other.rotation @ one.rotation.T
    x, y, z = other.translation - rotation @ one.translation
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.linalg.inv(other.matrix).T @ cross @ rotation @ np.linalg.inv(one.matrix))


def epipolar_distance(
    one: Points, other: Points, fundamental: Float[np.ndarray, "3 3"]
) -> tuple[Values, Values]:
    """First-order distance of pairs of points from the epipolar constraint (Sampson's).

    Args:
        one: Points of the first image, pixels.
        other: The same points in the second.
        fundamental: `fundamental_matrix` of the two cameras.

    Returns:
        The distance, pixels, and the share w of the first image: the variance of the distance is
        w σ² of the first point + (1 − w) σ² of the second.
    """
    first, second = (
        np.concatenate([part, np.ones((*part.shape[:-1], 1))], -1) for part in (one, other)
    )
    line_in_second, line_in_first = first @ fundamental.T, second @ fundamental
    weights = [np.square(line[..., :2]).sum(-1) for line in (line_in_first, line_in_second)]
    total = weights[0] + weights[1]
    return (second * line_in_second).sum(-1) / np.sqrt(total), weights[0] / total


@dataclass(frozen=True)
class Clip:
    """Hands of the frames in which both cameras found a right hand."""

    cameras: tuple[Camera, Camera]
    """The two cameras."""
    hands: tuple[tuple[CopiedHand, ...], tuple[CopiedHand, ...]]
    """The hands of each camera."""
    frames: tuple[int, ...]
    """Number of each frame."""

    @property
    def sides(self) -> tuple[Float[np.ndarray, "frame 1"], Float[np.ndarray, "frame 1"]]:
        """Side of each hand's square, per camera, pixels."""
        one, other = (np.array([[hand.side] for hand in hands]) for hands in self.hands)
        return one, other

    def landmarks(self, copies: int) -> tuple[Points, Points]:
        """Undistorted means of the first readings and some copies, per camera, pixels."""
        return tuple(  # type: ignore[return-value]  # two cameras
            camera.undistorted(np.array([_mean(hand, copies) for hand in hands]))
            for camera, hands in zip(self.cameras, self.hands, strict=True)
        )

    def spread(self, table: NoiseTable, copies: int, *, use: str = "both") -> tuple[Values, Values]:
        """Spread of each landmark, per camera, pixels.

        Args:
            table: Table of the spread.
            copies: Number of copies.
            use: `table`, `copies`, `both`, or `equal` for the same share of the square for all landmarks.
        """
        return tuple(  # type: ignore[return-value]  # two cameras
            np.array([hand.side * _spread(hand, table, copies, use) for hand in hands])
            for hands in self.hands
        )


def _mean(hand: CopiedHand, copies: int) -> Float[np.ndarray, "landmark=21 2"]:
    readings = np.concatenate([hand.reading.landmarks_2d[None], hand.copies[:copies]])
    return np.asarray(readings.mean(axis=0), dtype=np.float64)


def _spread(
    hand: CopiedHand, table: NoiseTable, copies: int, use: str
) -> Float[np.ndarray, "landmark=21"]:
    if use == "equal":
        return np.ones(21)
    if use == "table" or not copies:
        return table.spread(hand.features)
    if use == "copies":
        return hand.spread(copies)
    return combined_spread(table.spread(hand.features), hand.spread(copies))


def read_clip(folder: Path, every: int) -> Clip:
    """Read `calibration.json`, `cam0.mp4` and `cam1.mp4` of a folder.

    Args:
        folder: The folder.
        every: Step between frames.

    Raises:
        FileNotFoundError: A file is missing.
    """
    values = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    read = [read_hands(video_frames(folder / f"cam{number}.mp4", every)) for number in (0, 1)]
    pairs = [
        (every * number, one, other)
        for number, (one, other) in enumerate(zip(*read, strict=False))
        if one is not None
        and other is not None
        and one.reading.side == other.reading.side == "right"
    ]
    frames, first, second = zip(*pairs, strict=True)
    return Clip((Camera.read(values["cam0"]), Camera.read(values["cam1"])), (first, second), frames)


def video_frames(path: Path, every: int = 1) -> Iterator[Image]:
    """Read some frames of a video, RGB.

    Args:
        path: The video.
        every: Step between frames.

    Raises:
        FileNotFoundError: There is no such video.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No video at {path}; expected cam0.mp4 and cam1.mp4 in the folder."
        )
    video, number = cv2.VideoCapture(str(path)), 0
    while video.grab():
        if number % every == 0:
            _, frame = video.retrieve()
            yield np.ascontiguousarray(frame[..., ::-1], dtype=np.uint8)
        number += 1


@dataclass(frozen=True)
class Calibration:
    """Agreement of σ with the distances from the epipolar constraint."""

    gain: float
    """Most likely σ per spread."""
    rms: float
    """Root mean square σ of a landmark by this gain, pixels of a square of `SQUARE`."""
    within: tuple[float, float]
    """Shares of distances within 1 and 2 σ; 0.683 and 0.954 of a Gaussian."""
    likelihood: float
    """Mean negative logarithm of the likelihood of a distance, without its constant."""
    correlation: float
    """Spearman's rank correlation of σ and the distance, over all landmarks of all frames."""
    correlation_in_hand: float
    """Mean of the rank correlations within a frame."""


def calibrate(clip: Clip, table: NoiseTable, copies: int, use: str = "both") -> Calibration:
    """Find the most likely σ per spread on a clip, and how well that σ agrees with the distances.

    Args:
        clip: The clip.
        table: Table of the spread.
        copies: Number of copies, whose mean is the landmark.
        use: Source of the spread, as for `Clip.spread`.
    """
    one, other = clip.landmarks(copies)
    distance, share = epipolar_distance(one, other, fundamental_matrix(*clip.cameras))
    spreads = clip.spread(table, copies, use=use)
    scale = np.sqrt(share * np.square(spreads[0]) + (1 - share) * np.square(spreads[1]))
    gain = float(np.sqrt(np.square(distance / scale).mean()))
    sigma, error = gain * scale, np.abs(distance)
    inside = error / sigma
    relative = [
        gain * spread / side * SQUARE for spread, side in zip(spreads, clip.sides, strict=True)
    ]
    return Calibration(
        gain=gain,
        rms=float(np.sqrt(np.square(relative).mean())),
        within=(float((inside < 1).mean()), float((inside < 2).mean())),
        likelihood=float((np.log(sigma) + np.square(inside) / 2).mean()),
        correlation=rank_correlation(sigma, error),
        correlation_in_hand=float(
            np.mean([rank_correlation(*pair) for pair in zip(sigma, error, strict=True)])
        ),
    )


def rank_correlation(one: Float[np.ndarray, "*n"], other: Float[np.ndarray, "*n"]) -> float:
    """Spearman's rank correlation of all values."""
    return float(spearmanr(one.ravel(), other.ravel())[0])
