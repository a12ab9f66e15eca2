"""Scores of motions against ground truth, and their table."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import torch
from jaxtyping import Float

from depth.scores import aligned_errors, second_view_errors
from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.motion.jitter import acceleration_error, jitter_millimetres, jitter_pixels
from hand_recon.motion.posing import landmarks_of
from motion.clips import MotionClip
from motion.fits import FittedClip, Motion

AWAY: Final = np.deg2rad(25)
"""Distance of a finger's nine angles from those between its neighbours in time that is a flip."""

BACK: Final = np.deg2rad(30)
"""Largest distance of the neighbours' angles of a flip: the finger was away for one frame."""


@dataclass(frozen=True)
class Scores:
    """Scores of a motion in the frames in which the hand was found; those of bridged frames are apart."""

    error: float
    """PA-MPJPE (E_J), millimetres."""
    jitter: float
    """Mean acceleration of the landmarks in the camera's frame, mm/s²."""
    relative_jitter: float
    """Mean acceleration of the landmarks from the middle MCP, mm/s²."""
    acceleration_error: float
    """Mean error of the acceleration from the middle MCP, of the hand scaled to the ground truth, mm/s²."""
    jitter_pixels: float
    """Root mean square distance of projections from between their neighbours in time, pixels."""
    flips: float
    """Frames in which a finger is elsewhere than in the frames before and after."""
    second_view: float
    """Mean distance in the second camera, pixels."""
    bridged_error: float
    """PA-MPJPE (E_J) of bridged frames, millimetres."""
    milliseconds: float
    """Processor time per frame for the choice and smoothing."""


def scores_of(fitted: FittedClip, motion: Motion) -> Scores:
    """Score a motion.

    Args:
        fitted: The clip.
        motion: A motion from it.
    """
    clip = fitted.clip
    every = landmarks_of(motion.trajectory, fitted.hand)
    found = every[clip.frames]
    gaps = np.setdiff1d(np.arange(len(every)), clip.frames)
    truth = clip.ground_truth
    second = float("nan")
    if clip.second is not None:
        second = float(second_view_errors(torch.from_numpy(found), clip.second).mean())
    return Scores(
        _error(truth[clip.frames], found),
        *_jitters(clip, found),
        flips_of(motion.poses.joint_angles),
        second,
        _error(truth[gaps], every[gaps]) if np.isfinite(truth[gaps]).all() else float("nan"),
        motion.milliseconds,
    )


def scores_of_truth(clip: MotionClip) -> Scores:
    """Scores of the ground truth itself: the jitter that the hand has.

    Args:
        clip: The clip.
    """
    truth = clip.ground_truth[clip.frames]
    none = float("nan")
    return Scores(0.0, *_jitters(clip, truth), none, none, none, none)


def _jitters(
    clip: MotionClip, points: Float[np.ndarray, "frame landmark=21 3"]
) -> tuple[float, float, float, float]:
    truth, times = clip.ground_truth[clip.frames], clip.frames / clip.rate
    own, expected = (each - each[:, ROOT_LANDMARK, None] for each in (points, truth))
    scale = (own * expected).sum() / np.square(own).sum()
    camera = clip.landmarks.intrinsics
    if camera is None:
        raise ValueError("Found a clip without a camera; expected one.")
    pixels = points @ camera[0].numpy().T
    return (
        jitter_millimetres(points, times),
        jitter_millimetres(own, times),
        acceleration_error(scale * own, expected, times),
        jitter_pixels(pixels[..., :2] / pixels[..., 2:], times),
    )


def _error(
    truth: Float[np.ndarray, "frame landmark=21 3"], found: Float[np.ndarray, "frame landmark=21 3"]
) -> float:
    if not len(found):
        return float("nan")
    return float(aligned_errors(torch.from_numpy(truth), torch.from_numpy(found)).mean())


def flips_of(joint_angles: Float[np.ndarray, "frame joint=15 axis=3"]) -> float:
    """Number of frames in which a finger is away from where it is in the frames before and after.

    Args:
        joint_angles: Bend, splay and twist in successive frames, radians.
    """
    fingers = joint_angles.reshape(-1, 5, 9)
    away = fingers[1:-1] - (fingers[2:] + fingers[:-2]) / 2
    back = fingers[2:] - fingers[:-2]
    flipped = (np.linalg.norm(away, axis=-1) > AWAY) & (np.linalg.norm(back, axis=-1) < BACK)
    return float(flipped.any(axis=1).sum())


def outside_of_ranges(joint_angles: Float[np.ndarray, "frame joint=15 axis=3"]) -> float:
    """Largest violation of the ranges of motion of the literature, degrees.

    Args:
        joint_angles: Bend, splay and twist, radians.
    """
    angles = torch.from_numpy(joint_angles)
    inside = load_ranges("literature").clamp(angles)
    return float((angles - inside).abs().max().rad2deg())


TITLES: Final = (
    "PA-MPJPE, mm", "jitter, mm/s²", "without the place", "acceleration error, mm/s²", "jitter, px",
    "flips", "second view, px", "PA-MPJPE in gaps, mm", "ms per frame",
)  # fmt: skip
"""Titles of the columns of `Scores`."""


def markdown(rows: Sequence[tuple[str, str, Scores]]) -> str:
    """Table of scores.

    Args:
        rows: Clip, motion and scores.
    """
    lines = [_line(["clip", "motion", *TITLES]), _line(["---"] * (len(TITLES) + 2))]
    for clip, name, scores in rows:
        values = [getattr(scores, field.name) for field in fields(scores)]
        lines.append(_line([clip, name, *(_number(value) for value in values)]))
    return "\n".join(lines)


def _number(value: float) -> str:
    if np.isnan(value):
        return "—"
    return f"{value:.0f}" if value >= 100 or value == int(value) else f"{value:.2f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
