"""Motion at every frame: gaps are bridged by the model of smoothing, and left hands mirrored back."""

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline

from hand_recon.detection.detector import Side
from hand_recon.motion.estimates import ANGLES, PLACE, ROTATION
from hand_recon.motion.poses import Poses, coordinates_of, rotated
from hand_recon.motion.smoothing import within
from hand_recon.motion.trajectory import Trajectory, mirror_of


def bridged(
    poses: Poses,
    frames: Int[np.ndarray, " all"],
    times: Float[np.ndarray, " all"],
    *,
    straight: bool = False,
) -> Poses:
    """Add poses for frames in which the hand was not seen.

    Between frames, the most probable motion of the model of smoothing is a natural cubic spline through the
    smoothed poses. Joint angles stay between the least and the largest of the given ones.

    Args:
        poses: Poses in the frames in which the hand was seen.
        frames: Numbers of the frames that are wanted, increasing, from the first of the poses to the last,
            and all of these among them.
        times: Their times, seconds, increasing.
        straight: True for linear interpolation, which suits poses that were not smoothed.

    Returns:
        Poses of all wanted frames; those that are added have the certainty zero.

    Raises:
        ValueError: A frame with a pose is not wanted, or a wanted one is before or after all poses.
    """
    added = ~np.isin(frames, poses.frames)
    known = frames[~added]
    if not np.array_equal(known, poses.frames) or frames[0] < known[0] or frames[-1] > known[-1]:
        raise ValueError(
            f"Found {len(poses)} poses of frames {poses.frames[0]} to {poses.frames[-1]}, and {len(frames)} "
            f"wanted ones, {frames[0]} to {frames[-1]}; expected to want every frame with a pose, and none "
            "before the first or after the last."
        )
    if not added.any():
        return poses
    coordinates = coordinates_of(poses)
    found = _interpolated(poses.times, coordinates, times[added], straight=straight)
    before = np.searchsorted(poses.times, times[added]) - 1
    turned = found[:, ROTATION] - coordinates[before, ROTATION]
    more = Poses(
        frames[added],
        times[added],
        within(found[:, ANGLES], coordinates[:, ANGLES]).reshape(-1, 15, 3),
        rotated(poses.root_rotation[before], turned),
        found[:, PLACE],
        np.zeros(int(added.sum())),
    )
    return _merged(poses, more)


def _interpolated(
    times: Float[np.ndarray, " frame"],
    values: Float[np.ndarray, "frame value"],
    wanted: Float[np.ndarray, " wanted"],
    *,
    straight: bool,
) -> Float[np.ndarray, "wanted value"]:
    """Values at further times, by a natural cubic spline or linearly."""
    if straight:
        columns = [np.interp(wanted, times, column) for column in values.T]
        return np.stack(columns, axis=1)
    return np.asarray(CubicSpline(times, values, bc_type="natural")(wanted))


def _merged(one: Poses, other: Poses) -> Poses:
    """Poses of two sets of frames, in order."""
    frames = np.concatenate([one.frames, other.frames])
    order = frames.argsort(kind="stable")
    return Poses(
        frames[order],
        np.concatenate([one.times, other.times])[order],
        np.concatenate([one.joint_angles, other.joint_angles])[order],
        np.concatenate([one.root_rotation, other.root_rotation])[order],
        np.concatenate([one.place, other.place])[order],
        np.concatenate([one.certainty, other.certainty])[order],
    )


def trajectory_of(
    poses: Poses, *, hand: int, side: Side, shape: Float[np.ndarray, " direction=10"]
) -> Trajectory:
    """Motion of a hand of its own side.

    Args:
        poses: Pose in every frame from the first to the last, those of a left hand mirrored.
        hand: Number of the hand in the clip, from 1.
        side: Side of the hand.
        shape: Shape coefficients, standard deviations.

    Raises:
        ValueError: Times do not increase.
    """
    depth = np.exp(poses.place[:, 2:])
    translation = np.concatenate([poses.place[:, :2] * depth, depth], axis=1)
    mirror = mirror_of(side)
    return Trajectory(
        hand=hand,
        side=side,
        frames=poses.frames,
        times=poses.times,
        joint_angles=poses.joint_angles,
        root_rotation=mirror[:, None] * poses.root_rotation * mirror,
        translation=translation * mirror,
        shape=shape,
        observed=poses.certainty > 0,
    )
