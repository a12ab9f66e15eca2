"""From minima in every frame to the motion of a hand: choice, smoothing, bridged gaps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from hand_recon.motion.bridging import bridged, trajectory_of
from hand_recon.motion.choice import chosen_poses
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.identity import Track
from hand_recon.motion.smoothing import smoothed
from hand_recon.motion.trajectory import Trajectory
from hand_recon.runs.clip.found_frames import FoundFrame


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
    seconds: float,
) -> HandMotion:
    """Choose, smooth and bridge.

    Args:
        track: The hand.
        shape: Its shape, standard deviations.
        estimates: Its minima in the frames in which it was seen.
        frames: All frames of the clip.
        seconds: Strength of smoothing, seconds.

    Raises:
        ValueError: No frame has a finite minimum.
    """
    poses = chosen_poses(estimates)
    wanted = _wanted(track, poses.frames)
    time_of = {frame.number: frame.time for frame in frames}
    times = np.array([time_of[number] for number in wanted.tolist()])
    coefficients = shape.double().numpy()

    def whole(of: float) -> Trajectory:
        there = bridged(smoothed(poses, of), wanted, times, straight=of == 0)
        return trajectory_of(there, hand=track.number, side=track.side, shape=coefficients)

    return HandMotion(whole(0.0), whole(seconds))


def _wanted(track: Track, posed: np.ndarray) -> np.ndarray:
    """Frames of a motion: those with a pose, and those of gaps that are bridged."""
    inside = [gap.frames for gap in track.gaps if gap.is_bridged]
    # Seen with too few landmarks to be fitted.
    unfitted = np.setdiff1d(track.frames, posed)
    wanted = np.unique(np.concatenate([posed, *inside, unfitted])).astype(np.int64)
    return np.asarray(wanted[(wanted >= posed[0]) & (wanted <= posed[-1])])
