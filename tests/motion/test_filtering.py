"""Smoothing frame by frame."""

from dataclasses import replace

import numpy as np
import pytest

from hand_recon.motion.choice import chosen_minima, poses_at, select_frames
from hand_recon.motion.estimates import FrameEstimates
from hand_recon.motion.filtering import LiveFilter
from hand_recon.motion.poses import Poses
from hand_recon.motion.smoothing import smoothed
from tests.support.made_up_motion import (
    assert_same_poses,
    moving_poses,
    only_minimum,
    some_frames,
    still_poses,
    with_minima,
)


def _frame(estimates: FrameEstimates, frame: int) -> FrameEstimates:
    return select_frames(estimates, np.array([frame]))


def _with_gap(poses: Poses) -> Poses:
    """Poses with a gap of two seconds in the middle."""
    return replace(poses, times=poses.times + 2.0 * (poses.frames >= len(poses) // 2))


@pytest.mark.parametrize("seconds", [0.0, 0.03, 0.2])
@pytest.mark.parametrize("gap", [False, True])
def test_each_pose_is_the_last_one_of_the_smoothed_motion_until_then(
    *, seconds: float, gap: bool
) -> None:
    poses = moving_poses(25, uneven=True)
    if gap:
        poses = _with_gap(poses)
    live = LiveFilter(seconds)
    for frame in range(25):
        found = live.update(_frame(only_minimum(poses), frame))
        until = smoothed(some_frames(poses, np.arange(frame + 1)), seconds)
        assert_same_poses(found, some_frames(until, np.array([frame])), tolerance=1e-8)


def test_no_strength_is_the_identity() -> None:
    poses = moving_poses(8)
    live = LiveFilter(0.0)
    for frame in range(8):
        found = live.update(_frame(only_minimum(poses), frame))
        assert_same_poses(found, some_frames(poses, np.array([frame])), tolerance=0.0)


def test_constant_velocity_has_no_lag() -> None:
    poses = moving_poses(40, noise=0.0)
    live = LiveFilter(0.1)
    for frame in range(40):
        found = live.update(_frame(only_minimum(poses), frame))
        assert_same_poses(found, some_frames(poses, np.array([frame])), tolerance=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_ends_the_best_path_until_then(seed: int) -> None:
    random = np.random.default_rng(seed)
    cost = random.exponential(6.0, size=(15, 3))
    cost[:, 2] = np.where(random.random(15) < 0.5, np.inf, cost[:, 2])
    estimates = with_minima(still_poses(15), random.normal(size=(15, 3)), cost)
    live = LiveFilter(0.0)
    for frame in range(15):
        found = live.update(_frame(estimates, frame))
        until = select_frames(estimates, np.arange(frame + 1))
        expected = poses_at(until, chosen_minima(until))
        assert_same_poses(found, some_frames(expected, np.array([frame])), tolerance=0.0)


def test_two_minima_that_are_alternately_best_do_not_flip() -> None:
    cost = np.tile([[0.0, 0.1], [0.1, 0.0]], (10, 1))
    estimates = with_minima(still_poses(20), np.tile([0.0, 1.5], (20, 1)), cost)
    live = LiveFilter(0.03)
    bends = [live.update(_frame(estimates, frame)).joint_angles[0, 0, 0] for frame in range(20)]
    np.testing.assert_array_equal(bends, 0.0)


def test_a_time_that_does_not_increase_is_refused() -> None:
    estimates = only_minimum(moving_poses(3))
    live = LiveFilter()
    live.update(_frame(estimates, 1))
    with pytest.raises(ValueError, match=r"0\.0 s after one at 0\.03.* expected increasing times"):
        live.update(_frame(estimates, 0))


def test_several_frames_or_none_with_a_minimum_are_refused() -> None:
    estimates = only_minimum(moving_poses(3))
    with pytest.raises(ValueError, match="Found 3 frames with 3 finite minima; expected one frame"):
        LiveFilter().update(estimates)
    absent = replace(_frame(estimates, 0), cost=np.full((1, 1), np.inf))
    with pytest.raises(ValueError, match="Found 1 frames with 0 finite minima"):
        LiveFilter().update(absent)


def test_a_strength_outside_of_its_interval_is_refused() -> None:
    with pytest.raises(ValueError, match=r"smoothing of -1 s"):
        LiveFilter(-1)
