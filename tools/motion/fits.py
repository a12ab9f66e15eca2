"""Fit of a clip frame by frame with one shape, and motions that are made from it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from jaxtyping import Float

from depth.methods import Method
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.detection.detector import Side
from hand_recon.hand.model import HandModel
from hand_recon.motion.bridging import bridged, trajectory_of
from hand_recon.motion.certainty import estimates_of
from hand_recon.motion.choice import chosen_poses, poses_at, select_frames
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.filtering import LiveFilter
from hand_recon.motion.poses import Poses
from hand_recon.motion.smoothing import smoothed
from hand_recon.motion.trajectory import Trajectory
from hand_recon.runs.clip.fitting import ShapeFit, shape_of_hands
from hand_recon.runs.configuration import build_hand
from hand_recon.runs.one_person import hands_of_person
from motion.clips import MotionClip

PART: Final = 64
"""Frames whose covariances are held at once."""


@dataclass(frozen=True)
class FittedClip:
    """Minima of the frames of a clip, all with one shape."""

    clip: MotionClip
    """The clip."""
    estimates: FrameEstimates
    """Minima of every frame in which the hand was found."""
    hand: HandModel
    """Hand model, without its surface."""
    shape: Float[np.ndarray, " direction=10"]
    """Shape of the hand, standard deviations."""


def fitted_clip(clip: MotionClip, method: Method) -> FittedClip:
    """Estimate the shape of a clip's hand, and the minima of each frame.

    Args:
        clip: The clip.
        method: Configuration of the fit.
    """
    config = method.config()
    shape = shape_of_hands(config, hands_of_person(clip.landmarks))
    fit = ShapeFit(config, shape)
    parts = []
    for first in range(0, len(clip.landmarks), PART):
        rows = slice(first, first + PART)
        minima = fit(to_crops(clip.landmarks.select(rows)).batch)
        parts.append(estimates_of(minima, clip.frames[rows], clip.frames[rows] / clip.rate))
    hand = build_hand(config).landmarks_only()
    return FittedClip(clip, FrameEstimates.join(parts), hand, shape.double().numpy())


@dataclass(frozen=True)
class Motion:
    """A motion that was made from the minima of a clip."""

    name: str
    """Name for tables."""
    poses: Poses
    """Poses in the frames in which the hand was found."""
    trajectory: Trajectory
    """Poses in all frames, gaps bridged."""
    milliseconds: float
    """Processor time per frame."""


def motions(fitted: FittedClip, strengths: Sequence[float]) -> list[Motion]:
    """The least cost of each frame alone, the chosen minima smoothed, and the same live.

    Args:
        fitted: The clip.
        strengths: Strengths of smoothing, seconds.
    """
    found = [_made(fitted, "each frame alone", _alone, 0.0)]
    for seconds in strengths:
        name = f"{seconds:g} s" if seconds else "chosen minima"
        found.append(_made(fitted, name, partial(_whole, seconds=seconds), seconds))
    for seconds in strengths:
        name = f"live, {seconds:g} s"
        found.append(_made(fitted, name, partial(live_poses, seconds=seconds), seconds))
    return found


def _alone(estimates: FrameEstimates) -> Poses:
    return poses_at(estimates, estimates.cost.argmin(axis=1))


def _whole(estimates: FrameEstimates, seconds: float) -> Poses:
    return smoothed(chosen_poses(estimates), seconds)


def live_poses(estimates: FrameEstimates, seconds: float) -> Poses:
    """Poses that are found frame by frame.

    Args:
        estimates: Minima of all frames.
        seconds: Strength of smoothing.
    """
    live = LiveFilter(seconds)
    found = [
        live.update(select_frames(estimates, np.array([row]))) for row in range(len(estimates))
    ]
    columns = ("frames", "times", "joint_angles", "root_rotation", "place", "certainty")
    return Poses(*(np.concatenate([getattr(one, name) for one in found]) for name in columns))


def _made(
    fitted: FittedClip, name: str, make: Callable[[FrameEstimates], Poses], seconds: float
) -> Motion:
    began = time.process_time()
    poses = make(fitted.estimates)
    milliseconds = 1000 * (time.process_time() - began) / len(poses)
    frames = np.arange(fitted.clip.frames[-1] + 1)
    whole = bridged(poses, frames, frames / fitted.clip.rate, straight=seconds == 0)
    side: Side = "left" if bool(fitted.clip.landmarks.left[0]) else "right"
    trajectory = trajectory_of(whole, hand=1, side=side, shape=fitted.shape)
    return Motion(name, poses, trajectory, milliseconds)
