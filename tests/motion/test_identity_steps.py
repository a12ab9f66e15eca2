"""Costs of taking a detection for a hand, by numbers worked out by hand, and what each term decides."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.motion.identity import identify
from hand_recon.motion.identity_settings import IdentitySettings
from hand_recon.motion.identity_steps import FrameHands, match_costs
from hand_recon.motion.identity_tracks import SeenHand, hand_size
from tests.support.moving_hands import detected, open_hand

STEP = 0.04
SIZE = hand_size(open_hand())
"""Size of the made-up hand, pixels."""


def right_shape(x: float, side: Side = "right", size: float = 1.0) -> DetectedHand:
    """A detection whose landmarks are those of a right hand about a point, whatever its side."""
    landmarks = open_hand(size)
    return detected(landmarks - landmarks.mean(axis=0) + np.array([x, 300.0]), side)


def last_number(*hands: list[DetectedHand]) -> tuple[int | None, ...]:
    """Numbers in the last frame of a clip."""
    frames = [FrameHands(number, STEP * number, tuple(one)) for number, one in enumerate(hands)]
    return identify(frames, IdentitySettings(shortest_track=1e-9)).numbers[-1]


def known(**fields: float) -> SeenHand:
    """A hand that was seen at time 0 and at x = 100."""
    hand = SeenHand(1, 0.0, right_shape(100).landmarks_2d, "right")
    return replace(hand, **fields)  # type: ignore[arg-type]  # each test's own


def test_size_of_a_square_is_half_its_diagonal() -> None:
    corners = np.full((21, 2), np.nan)
    corners[[0, 5, 9, 20]] = [[0, 0], [6, 0], [6, 8], [0, 8]]
    assert hand_size(corners) == pytest.approx(5)


def test_a_detection_where_it_is_expected_costs_nothing_but_time() -> None:
    # Growth after 0.0625 s: √(1 + (8 / 0.5 × 0.0625)²) = √2, and 2 ln √2 = 0.693. No side is known.
    costs = match_costs([known()], [right_shape(100)], 0.0625)
    assert costs.tolist() == [[pytest.approx(math.log(2))]]


def test_one_size_away_costs_one_half_per_squared_standard_deviation() -> None:
    # The standard deviation is 0.5 √2 sizes: ½ × 1 / 0.5 = 1.
    costs = match_costs([known()], [right_shape(100 + SIZE)], 0.0625)
    assert costs.tolist() == [[pytest.approx(1 + math.log(2))]]


def test_twice_the_size_costs_one_and_a_half() -> None:
    # ½ (ln 2 / 0.4)² = 1.501; the landmarks are off by one size of the smaller in √2 sizes: ½ × ½ / 0.5.
    costs = match_costs([known()], [right_shape(100, size=2.0)], 0.0625)
    assert costs.tolist() == [[pytest.approx(1.5014 + 0.5 + math.log(2), abs=1e-4)]]


def test_sides_cost_by_the_probability_that_they_are_the_same() -> None:
    # Both within log odds of ln 19, that is 0.95: 0.95² + 0.05² = 0.905, and 2 × 0.95 × 0.05 = 0.095.
    settings = IdentitySettings(side_limit=math.log(19))
    hands = [replace(right_shape(100, side), side_score=0.999) for side in ("right", "left")]
    costs = match_costs([known(side_votes=50.0)], hands, 0.0625, settings)
    expected = [[math.log(2) - math.log(2 * 0.905), math.log(2) - math.log(2 * 0.095)]]
    np.testing.assert_allclose(costs, expected)


def test_a_velocity_moves_the_expected_place_and_fades() -> None:
    hand = replace(known(), velocity=np.array([200.0, 0.0]))
    # 200 px/s × 0.3 s × (1 − e^(−t / 0.3)): 3.87 px after 0.02 s, 60 px at last.
    for time, moved in ((0.02, 3.870), (0.3, 37.927), (100.0, 60.0)):
        offset = hand.expected(time, IdentitySettings()) - hand.landmarks
        np.testing.assert_allclose(offset, np.tile([moved, 0.0], (21, 1)), atol=1e-3)


def test_hands_without_common_landmarks_do_not_match() -> None:
    one, other = right_shape(100), right_shape(100)
    one.landmarks_2d[10:] = np.nan
    other.landmarks_2d[:10] = np.nan
    hand = replace(known(), landmarks=one.landmarks_2d)
    assert match_costs([hand], [other], 0.04).tolist() == [[math.inf]]


def test_no_hands_have_no_costs() -> None:
    assert match_costs([], [right_shape(0)], 0.0).shape == (0, 1)
    assert match_costs([known()], [], 0.0).shape == (1, 0)


def test_a_hand_seen_just_now_goes_before_one_that_is_lost() -> None:
    # The lost hand may be anywhere by now, which makes no single place likely.
    lost, present = right_shape(180), right_shape(100)
    frames = [[present, lost]] * 10 + [[present]] * 20
    first, second = last_number(*frames[:10])
    assert last_number(*frames, [right_shape(112)]) == (first,)
    assert {first, second} == {1, 2}


def test_sides_alone_tell_which_hand_came_back() -> None:
    sides: tuple[Side, Side] = ("left", "right")
    both = [[right_shape(300, "left"), right_shape(400, "right")]] * 10
    for index, side in enumerate(sides):
        back = [*both, *[[]] * 15, [right_shape(350, side)]]
        assert last_number(*back) == (last_number(*both)[index],)


def test_sizes_alone_tell_which_hand_came_back() -> None:
    both = [[right_shape(300), right_shape(400, size=2.5)]] * 10
    for index, size in enumerate((1.0, 2.5)):
        back = [*both, *[[]] * 15, [right_shape(350, size=size)]]
        assert last_number(*back) == (last_number(*both)[index],)


def test_velocities_tell_hands_apart_that_met_unseen() -> None:
    # Both of one side, on one line, 18 px per frame; three frames are missing while they pass each other.
    def at(frame: int) -> list[DetectedHand]:
        return [right_shape(200 + 18 * frame), right_shape(600 - 18 * frame)]

    before = [at(frame) for frame in range(10)]
    after = [*before, [], [], [], at(13)]
    assert last_number(*after) == last_number(*before)


def test_two_observations_make_a_velocity_and_more_make_a_mean() -> None:
    settings = IdentitySettings(velocity_time=STEP / math.log(2))
    hand = known().seen_again(right_shape(100), 0.0, 0.0, settings)
    np.testing.assert_array_equal(hand.velocity, [0, 0])
    hand = hand.seen_again(right_shape(104), STEP, STEP, settings)
    np.testing.assert_allclose(hand.velocity, [100, 0])
    # Half of the old one and half of the new one, 4 px and 8 px per frame.
    hand = hand.seen_again(right_shape(112), 2 * STEP, STEP, settings)
    np.testing.assert_allclose(hand.velocity, [150, 0])
    assert hand.detections == 3
    assert hand.seconds == pytest.approx(2 * STEP)


@pytest.mark.parametrize("start", [0.0, 1e5])
@pytest.mark.parametrize("step", [0.01, 0.02, 0.04, 0.05, 0.1])
def test_the_least_time_is_enough_whenever_the_clip_starts(start: float, step: float) -> None:
    # Sums of times of a clock that runs for a day end up a little below 0.2 s.
    count = round(0.2 / step)
    times = start + step * np.arange(count + 20)
    for seen, expected in ((count, 1), (count - 1, 0)):
        frames = [
            FrameHands(number, time, (right_shape(100),) * (0 < number <= seen))
            for number, time in enumerate(times.tolist())
        ]
        assert len(identify(frames).tracks) == expected
