"""Choice among the minima of each frame."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_recon.motion.choice import (
    Candidates,
    change_costs,
    chosen_minima,
    chosen_poses,
    select_frames,
)
from hand_recon.motion.estimates import FrameEstimates
from tests.support.made_up_motion import (
    assert_same_poses,
    moving_poses,
    only_minimum,
    still_poses,
    with_minima,
)


def _alternating(frames: int = 20) -> FrameEstimates:
    """Two poses of a finger, 86° apart, of which now one, now the other is better by a hair."""
    cost = np.tile([[0.0, 0.1], [0.1, 0.0]], (frames // 2, 1))
    cost[0] = [0.0, 0.3]
    return with_minima(still_poses(frames), np.tile([0.0, 1.5], (frames, 1)), cost)


def _random_estimates(seed: int, frames: int = 5, count: int = 3) -> FrameEstimates:
    random = np.random.default_rng(seed)
    cost = random.exponential(3.0, size=(frames, count))
    cost[random.random(cost.shape) < 0.2] = np.inf
    cost[:, 0] = np.where(np.isfinite(cost).any(axis=1), cost[:, 0], 0.0)
    several = with_minima(still_poses(frames), random.normal(size=cost.shape), cost)
    turns = Rotation.from_rotvec(0.3 * random.normal(size=(frames * count, 3))).as_matrix()
    return replace(
        several,
        times=np.cumsum(random.uniform(0.01, 0.5, frames)),
        root_rotation=turns.reshape(frames, count, 3, 3),
        place=0.02 * random.normal(size=(frames, count, 3)),
    )


def test_the_least_cost_of_each_frame_flips_and_the_path_does_not() -> None:
    estimates = _alternating()
    assert (np.diff(estimates.cost.argmin(axis=1)) != 0).all()
    np.testing.assert_array_equal(chosen_minima(estimates), 0)


def test_strong_evidence_is_followed_from_its_first_frame() -> None:
    estimates = _alternating()
    cost = np.tile([0.0, 30.0], (20, 1))
    cost[12:] = [30.0, 0.0]
    assert chosen_minima(replace(estimates, cost=cost)).tolist() == [0] * 12 + [1] * 8


def test_one_bad_frame_is_not_followed() -> None:
    estimates = _alternating()
    cost = np.tile([0.0, 5.0], (20, 1))
    cost[9] = [10.0, 0.0]
    np.testing.assert_array_equal(chosen_minima(replace(estimates, cost=cost)), 0)


@pytest.mark.parametrize("seed", range(6))
def test_the_path_is_the_best_of_all_paths(seed: int) -> None:
    estimates = _random_estimates(seed)
    at = [Candidates.of(estimates, frame) for frame in range(5)]
    steps = [
        change_costs(before, after, float(seconds))
        for before, after, seconds in zip(at, at[1:], np.diff(estimates.times), strict=False)
    ]

    def total(path: tuple[int, ...]) -> float:
        own = sum(float(estimates.cost[frame, minimum]) for frame, minimum in enumerate(path))
        return own + sum(
            float(step[pair]) for step, pair in zip(steps, itertools.pairwise(path), strict=True)
        )

    best = min(itertools.product(range(3), repeat=5), key=total)
    assert tuple(chosen_minima(estimates)) == best


def test_the_cost_of_a_change_is_a_sum_over_the_parts_of_the_hand() -> None:
    before = Candidates.of(only_minimum(still_poses(1)), 0)
    angles = np.zeros((1, 15, 3))
    angles[0, 0, 0] = np.deg2rad(10)
    angles[0, 14, 1] = np.deg2rad(30)
    turned = Rotation.from_rotvec([0.0, np.deg2rad(15), 0.0]).as_matrix()[None]
    after = Candidates(angles, turned, np.array([[0.003, 0.004, -0.06]]), np.zeros(1))
    # Without time, the scales are 10°, 5°, 0.005 and 0.02: changes of 1, 3, 3, 1 and 3 scales.
    expected = 2 * (np.log(2) + np.log(10) + np.log(10) + np.log(2) + np.log(10))
    assert change_costs(before, after, 0.0)[0, 0] == pytest.approx(expected)


def test_the_scale_grows_with_time_as_the_hand_can_move() -> None:
    before = Candidates.of(only_minimum(still_poses(1)), 0)
    angles = np.zeros((1, 15, 3))
    angles[0, 3, 0] = 1.0
    after = replace(before, joint_angles=angles)
    scale = np.hypot(np.deg2rad(10), np.deg2rad(300) * 0.2)
    assert change_costs(before, after, 0.2)[0, 0] == pytest.approx(2 * np.log1p(1 / scale**2))


def test_a_change_costs_the_same_back() -> None:
    one, other = (Candidates.of(_random_estimates(2), frame) for frame in (0, 1))
    np.testing.assert_allclose(change_costs(one, other, 0.1), change_costs(other, one, 0.1).T)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_minima_in_a_frame_does_not_matter(seed: int) -> None:
    estimates = _random_estimates(seed)
    order = np.random.default_rng(seed).permuted(np.tile(np.arange(3), (5, 1)), axis=1)
    row = np.arange(5)[:, None]
    permuted = FrameEstimates(
        estimates.frames,
        estimates.times,
        estimates.joint_angles[row, order],
        estimates.root_rotation[row, order],
        estimates.place[row, order],
        estimates.certainty[row, order],
        estimates.cost[row, order],
    )
    assert_same_poses(chosen_poses(permuted), chosen_poses(estimates))


def test_constants_of_frames_and_a_shift_of_time_do_not_matter() -> None:
    estimates = _random_estimates(4)
    other = replace(
        estimates, cost=estimates.cost + np.arange(5.0)[:, None], times=estimates.times + 7.0
    )
    np.testing.assert_array_equal(chosen_minima(other), chosen_minima(estimates))


def test_absent_minima_are_never_chosen() -> None:
    estimates = _alternating()
    cost = estimates.cost.copy()
    cost[:, 0] = np.inf
    cost[3] = [0.0, np.nan]
    angles, place = estimates.joint_angles.copy(), estimates.place.copy()
    angles[~np.isfinite(cost)], place[~np.isfinite(cost)] = np.nan, np.nan
    holes = replace(estimates, cost=cost, joint_angles=angles, place=place)
    chosen = chosen_minima(holes)
    assert chosen[3] == 0
    assert (np.delete(chosen, 3) == 1).all()


def test_a_frame_without_a_minimum_is_left_out() -> None:
    estimates = _alternating()
    cost = estimates.cost.copy()
    cost[[0, 7]] = np.inf
    poses = chosen_poses(replace(estimates, cost=cost))
    assert poses.frames.tolist() == [frame for frame in range(20) if frame not in (0, 7)]


def test_without_any_minimum_the_error_says_so() -> None:
    estimates = _alternating()
    with pytest.raises(ValueError, match="20 frames of a hand without a finite minimum"):
        chosen_poses(replace(estimates, cost=np.full((20, 2), np.inf)))


def test_one_minimum_in_each_frame_is_the_path() -> None:
    poses = moving_poses(6)
    assert_same_poses(chosen_poses(only_minimum(poses)), poses, tolerance=0.0)


def test_one_frame_takes_its_least_cost() -> None:
    estimates = select_frames(_alternating(), np.array([1]))
    assert chosen_minima(estimates).tolist() == [1]
