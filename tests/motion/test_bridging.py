"""Motion at every frame."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_recon.motion.bridging import bridged, trajectory_of
from hand_recon.motion.smoothing import smoothed, spans
from tests.support.made_up_motion import assert_same_poses, moving_poses, some_frames

GAP = np.isin(np.arange(30), [5, 12, 13, 14, 15])


@pytest.mark.parametrize("straight", [False, True])
def test_steady_motion_is_bridged_exactly(*, straight: bool) -> None:
    poses = moving_poses(30, noise=0.0)
    found = bridged(some_frames(poses, ~GAP), poses.frames, poses.times, straight=straight)
    expected = replace(poses, certainty=np.where(GAP, 0.0, 1.0))
    assert_same_poses(found, expected)


def test_given_poses_are_kept_exactly() -> None:
    poses = moving_poses(30)
    kept = some_frames(poses, ~GAP)
    found = bridged(kept, poses.frames, poses.times)
    assert_same_poses(some_frames(found, ~GAP), kept, tolerance=0.0)
    np.testing.assert_array_equal(found.certainty > 0, ~GAP)


def test_without_a_gap_nothing_changes() -> None:
    poses = moving_poses(9)
    assert_same_poses(bridged(poses, poses.frames, poses.times), poses, tolerance=0.0)


def test_a_bridge_is_what_the_model_says_about_frames_without_information() -> None:
    poses = moving_poses(30, seed=3)
    seen = some_frames(poses, ~GAP)
    found = bridged(smoothed(seen, 0.1), poses.frames, poses.times)
    # Frames of next to no certainty in place of missing ones; those after them stand for a longer time.
    weights = np.full(30, 1e-9)
    weights[~GAP] = spans(seen.times)
    certainty = weights / spans(poses.times)
    expected = smoothed(replace(poses, certainty=certainty), 0.1)
    np.testing.assert_allclose(found.place, expected.place, rtol=0, atol=1e-6)


def test_straight_bridges_turn_about_one_axis() -> None:
    poses = moving_poses(3, noise=0.3)
    ends = some_frames(poses, np.array([0, 2]))
    middle = bridged(ends, poses.frames, poses.times, straight=True).root_rotation[1]
    before, after = ends.root_rotation
    half = Rotation.from_matrix(after @ before.T).as_rotvec() / 2
    np.testing.assert_allclose(middle, Rotation.from_rotvec(half).as_matrix() @ before, atol=1e-9)


def test_bridged_angles_stay_between_the_least_and_the_largest() -> None:
    poses = moving_poses(30, noise=0.5)
    kept = some_frames(poses, ~GAP)
    found = bridged(kept, poses.frames, poses.times).joint_angles
    assert (found >= kept.joint_angles.min(axis=0)).all()
    assert (found <= kept.joint_angles.max(axis=0)).all()


@pytest.mark.parametrize("wanted", [slice(1, 30), slice(0, 29), slice(0, 30, 2)])
def test_frames_with_poses_must_be_wanted(wanted: slice) -> None:
    poses = moving_poses(30)
    with pytest.raises(ValueError, match="expected to want every frame with a pose"):
        bridged(poses, poses.frames[wanted], poses.times[wanted])


def test_frames_beyond_the_poses_must_not_be_wanted() -> None:
    poses = moving_poses(30)
    with pytest.raises(ValueError, match="none before the first or after the last"):
        bridged(some_frames(poses, np.arange(1, 29)), poses.frames, poses.times)


def test_a_right_hand_is_placed_by_direction_and_depth() -> None:
    poses = replace(moving_poses(2), place=np.array([[0.5, -0.25, np.log(2.0)], [0.0, 0.1, 0.0]]))
    found = trajectory_of(poses, hand=3, side="right", shape=np.arange(10.0))
    np.testing.assert_allclose(found.translation, [[1.0, -0.5, 2.0], [0.0, 0.1, 1.0]])
    np.testing.assert_array_equal(found.root_rotation, poses.root_rotation)
    assert (found.hand, found.side, found.observed.tolist()) == (3, "right", [True, True])


def test_a_left_hand_is_the_mirror_image_of_the_right_one() -> None:
    poses = bridged(some_frames(moving_poses(30), ~GAP), np.arange(30), np.arange(30) / 30)
    shape = np.zeros(10)
    left, right = (
        trajectory_of(poses, hand=1, side=side, shape=shape) for side in ("left", "right")
    )
    points = np.random.default_rng(0).normal(size=(21, 3))
    mirror = np.array([-1.0, 1.0, 1.0])
    of_left = (points * mirror) @ left.root_rotation.swapaxes(1, 2) + left.translation[:, None]
    of_right = points @ right.root_rotation.swapaxes(1, 2) + right.translation[:, None]
    np.testing.assert_allclose(of_left, of_right * mirror, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(left.root_rotation), 1.0)
    np.testing.assert_array_equal(left.joint_angles, right.joint_angles)
    np.testing.assert_array_equal(left.observed, ~GAP)
