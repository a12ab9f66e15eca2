"""From minima in every frame to the motion of a hand: choice, smoothing, bridged gaps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Int
from torch import Tensor

from hand_recon.motion.bridging import bridged, trajectory_of
from hand_recon.motion.choice import chosen_poses
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.identity import Track
from hand_recon.motion.smoothing import smoothed
from hand_recon.motion.trajectory import Trajectory
from hand_recon.runs.clip.found_frames import FoundFrame
from hand_recon.runs.clip.options import MotionOptions


@dataclass(frozen=True)
class HandMotion:
    """Motion of a hand before and after smoothing, in the same frames."""

    raw: Trajectory
    """Every frame for itself, but for the choice of the minimum; gaps are bridged on a straight line."""
    smooth: Trajectory
    """The result."""


def motion_of(
    track: Track,
    shape: Tensor,
    estimates: FrameEstimates,
    frames: Sequence[FoundFrame],
    options: MotionOptions,
) -> HandMotion:
    """Choose, smooth and bridge.

    Args:
        track: The hand.
        shape: Its shape, standard deviations.
        estimates: Its minima in the frames in which it was seen.
        frames: All frames of the clip.
        options: Strength of smoothing, and the longest gap that is bridged: frames in which the hand was not
            seen, or with too few landmarks for a fit.

    Raises:
        ValueError: No frame has a finite minimum.
    """
    poses = chosen_poses(estimates)
    time_of = {frame.number: frame.time for frame in frames}
    wanted = _wanted(poses.frames, time_of, options.longest_gap)
    times = np.array([time_of[number] for number in wanted.tolist()])
    coefficients = shape.double().numpy()

    def whole(of: float) -> Trajectory:
        there = bridged(smoothed(poses, of), wanted, times, straight=of == 0)
        return trajectory_of(there, hand=track.number, side=track.side, shape=coefficients)

    return HandMotion(whole(0.0), whole(options.smoothing))


def _wanted(
    posed: Int[np.ndarray, " posed"], time_of: Mapping[int, float], longest_gap: float
) -> Int[np.ndarray, " wanted"]:
    """Frames of a motion: those with a pose, and those between two that are not too far apart in time."""
    numbers = np.array(sorted(time_of))
    wanted = [posed]
    for before, after in pairwise(posed.tolist()):
        if time_of[after] - time_of[before] <= longest_gap:
            wanted.append(numbers[(numbers > before) & (numbers < after)])
    return np.unique(np.concatenate(wanted)).astype(np.int64)
