"""Numbers and sides of a clip's hands: hands that cross, come back, are mixed up, or are none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.detection.detector import DetectedHand, Side
from hand_recon.motion.identity import Identities, identify
from hand_recon.motion.identity_settings import IdentitySettings
from hand_recon.motion.identity_steps import FrameHands, IdentityState, advance
from tests.support.moving_hands import Crossing, detected, open_hand

STEP = 0.04
"""Seconds from one frame to the next."""


def frames_of(hands: list[list[DetectedHand]], step: float = STEP) -> list[FrameHands]:
    return [FrameHands(number, step * number, tuple(one)) for number, one in enumerate(hands)]


def at(x: float, y: float = 300.0, side: Side = "right", **fields: float) -> DetectedHand:
    return detected(open_hand(side=side) + np.array([x, y]), side, **fields)


def numbers_by_truth(crossing: Crossing) -> list[set[int | None]]:
    """Numbers that each of the two hands was given."""
    clip = crossing.clip()
    found = identify(frames_of([[hand for _, hand in frame] for frame in clip]))
    numbers: list[set[int | None]] = [set(), set()]
    for frame, row in zip(clip, found.numbers, strict=True):
        for (hand, _), number in zip(frame, row, strict=True):
            numbers[hand].add(number)
    return numbers


def test_one_hand_is_one_track() -> None:
    found = identify(frames_of([[at(100 + 5 * step)] for step in range(20)]))
    (track,) = found.tracks
    assert (track.number, track.side, track.agreement, track.gaps) == (1, "right", 1.0, ())
    assert track.frames.tolist() == list(range(20))
    assert track.detections.tolist() == [0] * 20
    np.testing.assert_allclose(track.times, STEP * np.arange(20))
    assert found.numbers == ((1,),) * 20
    assert found.dropped == ()


def test_no_frames_and_no_hands_are_no_tracks() -> None:
    assert identify([]) == Identities((), (), ())
    assert identify(frames_of([[], []])) == Identities((), ((), ()), ())


def test_two_hands_that_cross_keep_their_numbers() -> None:
    assert sorted(numbers_by_truth(Crossing()), key=str) == [{1}, {2}]


@settings(deadline=None, max_examples=40)
@given(
    crossing=st.builds(
        Crossing,
        frames=st.integers(20, 100),
        offset=st.floats(0, 50),
        sides=st.sampled_from([("left", "right"), ("right", "left")]),
        hidden=st.sampled_from([0, 1, 2]),
        reach=st.floats(0, 90),
        noise=st.floats(0, 4),
        wrong_sides=st.floats(0, 0.15),
        seed=st.integers(0, 1000),
    )
)
def test_hands_of_two_sides_never_swap(crossing: Crossing) -> None:
    assert sorted(numbers_by_truth(crossing), key=str) == [{1}, {2}]


@settings(deadline=None, max_examples=20)
@given(
    side=st.sampled_from(["left", "right"]),
    offset=st.floats(10, 60),
    hidden=st.sampled_from([0, 1]),
    frames=st.integers(30, 60),
    seed=st.integers(0, 1000),
)
def test_hands_of_one_side_do_not_swap_either(
    side: Side, offset: float, hidden: int, frames: int, seed: int
) -> None:
    crossing = Crossing(frames, offset, (side, side), hidden, seed=seed)
    assert sorted(numbers_by_truth(crossing), key=str) == [{1}, {2}]


CLIP = [[hand for _, hand in frame] for frame in Crossing(30, wrong_sides=0.2, seed=3).clip()]


@settings(deadline=None, max_examples=20)
@given(st.randoms(use_true_random=False))
def test_the_order_of_detections_changes_nothing(random: object) -> None:
    orders = [random.sample(range(len(hands)), len(hands)) for hands in CLIP]  # type: ignore[attr-defined]
    plain = identify(frames_of(CLIP))
    permuted = identify(
        frames_of([[hands[i] for i in order] for hands, order in zip(CLIP, orders, strict=True)])
    )
    for order, row, other in zip(orders, plain.numbers, permuted.numbers, strict=True):
        assert [row[index] for index in order] == list(other)
    assert [track.side for track in plain.tracks] == [track.side for track in permuted.tracks]


@settings(deadline=None, max_examples=20)
@given(st.floats(0.01, 100), st.floats(-1e4, 1e4), st.floats(0, 1e5))
def test_scale_place_and_start_of_the_clip_change_nothing(
    scale: float, shift: float, start: float
) -> None:
    moved = [
        FrameHands(
            frame.number,
            start + frame.time,
            tuple(
                replace(hand, landmarks_2d=scale * hand.landmarks_2d + shift)
                for hand in frame.hands
            ),
        )
        for frame in frames_of(CLIP)
    ]
    assert identify(moved).numbers == identify(frames_of(CLIP)).numbers


def mirrored(hand: DetectedHand) -> DetectedHand:
    return replace(
        hand,
        landmarks_2d=hand.landmarks_2d * [-1, 1] + [800, 0],
        side="right" if hand.side == "left" else "left",
    )


def test_a_mirrored_clip_has_mirrored_sides() -> None:
    plain = identify(frames_of(CLIP))
    other = identify(frames_of([[mirrored(hand) for hand in hands] for hands in CLIP]))
    assert other.numbers == plain.numbers
    swapped = {"left": "right", "right": "left"}
    assert [track.side for track in other.tracks] == [swapped[one.side] for one in plain.tracks]
    assert {track.side for track in plain.tracks} == {"left", "right"}


def test_one_confident_frame_outvotes_several_doubtful_ones() -> None:
    # Log odds: 3 × ln(0.6 / 0.4) = 1.2 for left, ln(0.9 / 0.1) = 2.2 for right.
    doubtful = [[at(100, side="left", side_score=0.6)]] * 3
    found = identify(frames_of([*doubtful, [at(100, side_score=0.9)]]))
    assert [(track.side, track.agreement) for track in found.tracks] == [("right", 0.25)]
    (track,) = identify(frames_of(doubtful * 3 + [[at(100, side_score=0.9)]])).tracks
    assert (track.side, track.agreement) == ("left", 0.9)


def test_a_certain_frame_has_a_limited_vote() -> None:
    # One frame of log odds 13.8 counts 3.5; four of 1.4 make 5.5.
    frames = [[at(100, side_score=0.999999)]] + [[at(100, side="left", side_score=0.8)]] * 4
    assert identify(frames_of(frames)).tracks[0].side == "left"


def test_a_gap_is_listed_and_bridged_if_it_is_short() -> None:
    frames = frames_of([[at(100)]] * 10 + [[]] * 3 + [[at(100)]] * 10 + [[]] * 20 + [[at(100)]] * 9)
    (track,) = identify(frames).tracks
    short, long = track.gaps
    assert short.frames.tolist() == [10, 11, 12]
    assert short.seconds == pytest.approx(4 * STEP)
    assert short.is_bridged
    assert long.frames.tolist() == list(range(23, 43))
    assert long.seconds == pytest.approx(21 * STEP)
    assert not long.is_bridged
    (track,) = identify(frames, IdentitySettings(longest_gap=0.9)).tracks
    assert all(gap.is_bridged for gap in track.gaps)


def test_after_a_long_absence_a_hand_has_a_new_number() -> None:
    hands = [[at(100)]] * 10 + [[]] * 60 + [[at(100)]] * 10
    found = identify(frames_of(hands))
    assert [track.frames.tolist() for track in found.tracks] == [[*range(10)], [*range(70, 80)]]
    assert len(identify(frames_of(hands), IdentitySettings(remember=3.0)).tracks) == 1


def test_after_an_absence_the_side_tells_hands_apart() -> None:
    # Both hands leave; one comes back between the two places.
    both = [[at(300, side="left"), at(420, side="right")]] * 10
    sides: tuple[Side, Side] = ("left", "right")
    for number, side in enumerate(sides, start=1):
        found = identify(frames_of(both + [[]] * 20 + [[at(360, side=side)]] * 10))
        assert [track.side for track in found.tracks] == ["left", "right"]
        assert found.numbers[-1] == (number,)


def test_a_hand_far_away_is_another_hand() -> None:
    found = identify(frames_of([[at(100)]] * 10 + [[at(700)]] * 10))
    assert len(found.tracks) == 2


def test_a_short_flash_is_dropped_aloud() -> None:
    hands = [[at(100)] + [at(600)] * (8 <= number < 11) for number in range(30)]
    found = identify(frames_of(hands))
    assert [track.number for track in found.tracks] == [1]
    assert found.numbers[9] == (1, None)
    assert found.dropped == (
        "a hand in frames 8 to 10 is left out: seen for 0.12 s, less than 0.2 s",
    )


def test_a_hand_of_low_scores_is_dropped_aloud() -> None:
    hands = [[at(100, score=0.55), at(600, score=0.65)]] * 30
    found = identify(frames_of(hands))
    assert found.numbers[0] == (None, 1)
    (sentence,) = found.dropped
    assert "frames 0 to 29 is left out: mean score 0.55, below 0.6" in sentence


def test_hands_without_scores_are_kept() -> None:
    (track,) = identify(frames_of([[replace(at(100), score=None)]] * 10)).tracks
    assert track.mean_score is None


@pytest.mark.parametrize("length", [1, 2, 3, 4, 5, 6, 7])
def test_a_hand_of_every_frame_is_kept_in_a_short_clip(length: int) -> None:
    for step in (0.1 / 3, 0.04, 0.01):
        assert len(identify(frames_of([[at(100)]] * length, step)).tracks) == 1


def test_missing_landmarks_are_no_reason_for_a_new_number() -> None:
    rng = np.random.default_rng(5)
    hands = []
    for step in range(20):
        hand = at(100 + 4 * step)
        hand.landmarks_2d[rng.permutation(21)[:12]] = np.nan
        hands.append([hand])
    assert len(identify(frames_of(hands)).tracks) == 1


@pytest.mark.parametrize("present", [0, 1, 2])
def test_detections_without_a_size_have_no_number(present: int) -> None:
    empty = detected(np.full((21, 2), np.nan))
    empty.landmarks_2d[:present] = np.array([[100.0, 300.0], [110.0, 300.0]])[:present]
    point = detected(np.full((21, 2), 100.0))
    assert identify(frames_of([[empty, point, at(100)]] * 10)).numbers == ((None, None, 1),) * 10


def test_step_by_step_numbers_are_those_of_the_clip() -> None:
    state = IdentityState()
    given = []
    for frame in frames_of(CLIP):
        state, numbers = advance(state, frame)
        given.append(numbers)
    found = identify(frames_of(CLIP))
    # Nothing was dropped, so that no number changed.
    assert found.dropped == ()
    assert tuple(given) == found.numbers
    assert [hand.side for hand in state.hands] == [track.side for track in found.tracks]
    assert all(hand.doubt(IdentitySettings()) is None for hand in state.hands)


def test_forgotten_hands_leave_the_state() -> None:
    state = IdentityState()
    for number in range(20):
        # A hand somewhere else every three seconds.
        state, (given,) = advance(state, FrameHands(number, 3.0 * number, (at(10 * number),)))
        assert given == number + 1
        assert len(state.hands) == 1
    with pytest.raises(KeyError):
        state.hand(1)


def test_times_that_do_not_increase_are_refused() -> None:
    frames = [FrameHands(0, 0.04, ()), FrameHands(1, 0.04, ())]
    with pytest.raises(ValueError, match=r"Frame 1 is at 0.04 s.*expected times that increase"):
        identify(frames)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"remember": 0.0}, r"identity.remember above 0, found 0"),
        ({"largest_cost": -1.0}, r"identity.largest_cost above 0, found -1"),
        ({"place_spread": float("nan")}, r"identity.place_spread above 0, found nan"),
        ({"least_score": 1.5}, r"identity.least_score between 0 and 1, found 1.5"),
    ],
)
def test_settings_out_of_range_are_refused(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        IdentitySettings(**fields)
