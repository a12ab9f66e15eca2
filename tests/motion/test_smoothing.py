"""Smoothing of a whole clip."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hand_recon.motion.poses import Poses, developed, rotated
from hand_recon.motion.smoothing import LONGEST_SPAN, smoothed, smoothing_spline, spans
from tests.support.made_up_motion import (
    assert_same_poses,
    moving_poses,
    some_frames,
    still_poses,
)


def _dense_filter_model(
    times: np.ndarray, values: np.ndarray, weights: np.ndarray, seconds: float
) -> np.ndarray:
    """Most probable positions by dense least squares over all positions and velocities.

    Measurements have the variance 1 / weight; from frame to frame position and velocity change by the
    covariance of accelerated motion with the density τ⁻⁴.
    """
    count = len(times)
    rows, right = [], []
    for frame in range(count):
        row = np.zeros((1, 2 * count))
        row[0, 2 * frame] = np.sqrt(weights[frame])
        rows.append(row)
        right.append(row[:, 2 * frame : 2 * frame + 1] * values[frame])
    for frame, step in enumerate(np.diff(times)):
        moved = np.array([[1.0, step], [0.0, 1.0]])
        spread = np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]]) / seconds**4
        white = np.linalg.inv(np.linalg.cholesky(spread))
        row = np.zeros((2, 2 * count))
        row[:, 2 * frame : 2 * frame + 2] = -white @ moved
        row[:, 2 * frame + 2 : 2 * frame + 4] = white
        rows.append(row)
        right.append(np.zeros((2, values.shape[1])))
    found = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    return found[::2]


def _steady(frames: int, *, uneven: bool) -> Poses:
    """A hand of constant velocity that turns about one axis."""
    poses = moving_poses(frames, noise=0.0, uneven=uneven)
    angles = np.arange(45.0) * poses.times[:, None] / 50 - 0.3
    turned = Rotation.from_rotvec(poses.times[:, None] * [1.0, -2.0, 2.0]).as_matrix()
    place = np.array([0.1, -0.2, -0.6]) + poses.times[:, None] * [0.3, 0.2, -0.1]
    start = Rotation.from_rotvec([0.4, 2.0, -1.0]).as_matrix()
    return replace(
        poses, joint_angles=angles.reshape(-1, 15, 3), root_rotation=turned @ start, place=place
    )


@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.7])
def test_the_spline_is_the_most_probable_motion(seconds: float) -> None:
    poses = moving_poses(9, uneven=True)
    values = np.random.default_rng(1).normal(size=(9, 4))
    weights = poses.certainty * spans(poses.times)
    expected = _dense_filter_model(poses.times, values, weights, seconds)
    found = smoothing_spline(poses.times, values, weights, seconds)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("seconds", [0.03, 0.5])
def test_constant_velocity_is_kept_without_lag(*, uneven: bool, seconds: float) -> None:
    poses = _steady(25, uneven=uneven)
    assert_same_poses(smoothed(poses, seconds), poses)


@pytest.mark.parametrize("seconds", [0.05, 0.1])
def test_independent_noise_keeps_the_predicted_share_of_its_variance(seconds: float) -> None:
    noise = np.random.default_rng(0).normal(size=(3000, 51))
    times = np.arange(3000) / 30
    found = smoothing_spline(times, noise, spans(times), seconds)[50:-50]
    predicted = 3 / 30 / (8 * np.sqrt(2) * seconds)
    assert found.var() == pytest.approx(predicted, rel=0.05)


@pytest.mark.parametrize("rate", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("certainty", [0.1, 1.0, 10.0])
def test_a_sine_is_damped_by_time_and_certainty_not_by_frame_rate(
    rate: float, certainty: float
) -> None:
    times = np.arange(0.0, 20.0, 1 / rate)
    wave = np.sin(2 * np.pi * times)[:, None]
    found = smoothing_spline(times, wave, certainty * spans(times), 0.15)
    expected = 1 / (1 + (2 * np.pi * 0.15) ** 4 / certainty)
    inner = slice(len(times) // 4, -len(times) // 4)
    np.testing.assert_allclose(found[inner], expected * wave[inner], rtol=0, atol=3e-3)


def test_twice_the_frames_of_half_the_certainty_are_as_certain() -> None:
    times = np.arange(0.0, 4.0, 1 / 30)
    values = np.random.default_rng(3).normal(size=(len(times), 1))
    once = smoothing_spline(times, values, np.full(len(times), 1 / 30), 0.1)
    close = np.stack([times - 1e-5, times + 1e-5], axis=1).ravel()
    twice = smoothing_spline(close, values.repeat(2, axis=0), np.full(len(close), 1 / 60), 0.1)
    np.testing.assert_allclose(twice[::2], once, rtol=0, atol=1e-3)


def test_the_frame_that_is_less_certain_moves_more() -> None:
    poses = still_poses(21)
    poses.place[7, 0] = poses.place[14, 0] = 1.0
    poses.certainty[14] = 0.1
    found = smoothed(poses, 0.05).place[:, 0]
    assert found[7] > 2 * found[14] > 0


@pytest.mark.parametrize("frames", [1, 2, 30])
def test_no_strength_is_the_identity(frames: int) -> None:
    poses = moving_poses(frames)
    assert_same_poses(smoothed(poses, 0.0), poses, tolerance=0.0)


def test_one_or_two_frames_are_kept() -> None:
    for frames in (1, 2):
        poses = moving_poses(frames)
        assert_same_poses(smoothed(poses, 0.1), poses, tolerance=0.0)


def test_a_shift_of_time_changes_nothing() -> None:
    poses = moving_poses(30, uneven=True)
    found = smoothed(replace(poses, times=poses.times + 4.0), 0.1)
    assert_same_poses(replace(found, times=poses.times), smoothed(poses, 0.1))


@pytest.mark.parametrize("side", ["camera", "hand"])
def test_axes_of_the_camera_and_of_the_hand_do_not_matter(side: str) -> None:
    poses = moving_poses(30, uneven=True)
    other = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()

    def changed(given: Poses) -> Poses:
        rotation = given.root_rotation
        rotation = other @ rotation if side == "camera" else rotation @ other
        return replace(given, root_rotation=rotation)

    assert_same_poses(smoothed(changed(poses), 0.1), changed(smoothed(poses, 0.1)))


def test_time_backwards_gives_the_motion_backwards() -> None:
    poses = moving_poses(30)
    back = replace(some_frames(poses, np.arange(30)[::-1]), frames=poses.frames, times=poses.times)
    found = smoothed(back, 0.1)
    forth = smoothed(poses, 0.1)
    np.testing.assert_allclose(found.joint_angles, forth.joint_angles[::-1], atol=1e-9)
    np.testing.assert_allclose(found.place, forth.place[::-1], atol=1e-9)
    # Rotations about changing axes do not commute, so that the curve backwards is another one.
    np.testing.assert_allclose(found.root_rotation, forth.root_rotation[::-1], atol=0.02)


def test_smoothing_moves_rotations_towards_the_steady_turn() -> None:
    noisy, exact = moving_poses(60, seed=2, noise=0.1), moving_poses(60, seed=2, noise=0.0)

    def off(poses: Poses) -> float:
        between = Rotation.from_matrix(exact.root_rotation.swapaxes(1, 2) @ poses.root_rotation)
        return float(np.square(between.magnitude()).mean())

    assert off(smoothed(noisy, 0.1)) < 0.25 * off(noisy)


def test_the_developed_curve_of_a_turn_about_one_axis_is_its_angle() -> None:
    angle = np.linspace(0.0, 20.0, 60)
    axis = np.array([0.6, 0.0, -0.8])
    start = Rotation.from_rotvec([1.0, 2.0, 0.5]).as_matrix()
    turning = Rotation.from_rotvec(angle[:, None] * axis).as_matrix() @ start
    np.testing.assert_allclose(developed(turning), angle[:, None] * axis, atol=1e-9)
    np.testing.assert_allclose(rotated(turning, -angle[:, None] * axis), [start] * 60, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 12), st.floats(0.0, 1.0))
def test_joint_angles_stay_between_the_least_and_the_largest(
    seed: int, frames: int, seconds: float
) -> None:
    poses = moving_poses(frames, seed=seed, noise=0.4, uneven=True)
    found = smoothed(poses, seconds).joint_angles
    assert (found >= poses.joint_angles.min(axis=0)).all()
    assert (found <= poses.joint_angles.max(axis=0)).all()


def test_the_spline_itself_would_overshoot() -> None:
    """The interval of joint angles is needed: a finger that stops overshoots without it."""
    times = np.arange(20) / 30
    stop = np.minimum(times, times[10])[:, None]
    assert smoothing_spline(times, stop, spans(times), 0.05).max() > stop.max() + 1e-3


def test_a_frame_stands_for_the_time_since_the_last_one_but_not_for_a_gap() -> None:
    np.testing.assert_allclose(
        spans(np.array([0.0, 0.04, 0.07, 2.0])), [0.04, 0.04, 0.03, LONGEST_SPAN]
    )
    assert spans(np.array([3.0])).tolist() == [LONGEST_SPAN]


@pytest.mark.parametrize("seconds", [-0.1, 1.5, float("nan")])
def test_a_strength_outside_of_its_interval_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match=r"smoothing of .* s; expected 0 \(none\) to 1 s"):
        smoothed(moving_poses(5), seconds)
