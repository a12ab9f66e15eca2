"""Hands of successive frames: on photographs with the published models, and on made-up hands without them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.detector import DetectedHand
from hand_recon.detection.hands import HandReading
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.regions import Region, region_of_landmarks
from hand_recon.detection.tracking import AFTER_LOSS, HandTracker, TrackerState
from tests.support.moving_hands import FRAME, MovingHand, MovingPalms, ReadsMovingHands


def tracked(
    frames: list[list[MovingHand]], palms_every: int = 10, **options: float
) -> tuple[list[tuple[DetectedHand, ...]], list[int], list[tuple[str, ...]]]:
    """Hands of every frame, the frames in which palms were looked for, and what was dropped."""
    detector = MediaPipeDetector(padding=1, **options)  # type: ignore[arg-type]  # each test's own
    tracker = HandTracker(detector, palms_every)
    found, searched, dropped = [], [], []
    state = None
    for number, hands in enumerate(frames):
        palms, reads = MovingPalms(hands), ReadsMovingHands(hands)
        vars(detector).update(find_palms=palms, read_hand=reads)
        detections, state = tracker(FRAME, state)
        found.append(detections.hands)
        dropped.append(detections.dropped)
        searched += [number] * palms.calls
    return found, searched, dropped


STILL = MovingHand(200, 200)


def test_palms_are_looked_for_once_in_so_many_frames_while_a_hand_is_followed() -> None:
    found, searched, _ = tracked([[STILL]] * 25, palms_every=10)
    assert searched == [0, 10, 20]
    assert all(len(hands) == 1 for hands in found)


def test_palms_every_frame_as_mediapipe_does() -> None:
    assert tracked([[STILL]] * 4, palms_every=1)[1] == [0, 1, 2, 3]


def test_palms_are_looked_for_in_every_frame_without_a_hand() -> None:
    found, searched, _ = tracked([[], [], [], [STILL], [STILL]])
    assert searched == [0, 1, 2, 3]
    assert [len(hands) for hands in found] == [0, 0, 0, 1, 1]


def test_the_largest_number_of_hands_ends_the_search() -> None:
    other = MovingHand(600, 200)
    found, searched, _ = tracked([[STILL, other]] * 25, max_hands=1)
    assert searched == [0]
    assert all(len(hands) == 1 for hands in found)
    assert tracked([[STILL, other]] * 25, max_hands=2)[1] == [0]
    assert tracked([[STILL, other]] * 25, max_hands=3)[1] == [0, 10, 20]


def test_a_lost_hand_starts_a_search_in_the_same_frame() -> None:
    # It jumps farther than its square reaches: lost where it was, found where it is.
    other = MovingHand(600, 200)
    found, searched, dropped = tracked([[STILL, other]] * 3 + [[STILL, MovingHand(600, 600)]] * 3)
    assert searched == [0, 3]
    assert all(len(hands) == 2 for hands in found)
    (sentence,) = dropped[3]
    assert "not above detector.min_presence=0.5" in sentence


def test_after_a_loss_palms_are_looked_for_for_a_while() -> None:
    other = MovingHand(600, 200)
    found, searched, _ = tracked([[STILL, other]] * 3 + [[STILL]] * 40)
    assert searched == [0, *range(3, 3 + AFTER_LOSS), 27, 37]
    # It comes back after six frames: found at once, and the search is over.
    found, searched, _ = tracked([[STILL, other]] * 3 + [[STILL]] * 6 + [[STILL, other]] * 20)
    assert [len(hands) for hands in found] == [2] * 3 + [1] * 6 + [2] * 20
    assert searched == [0, *range(3, 10), 19]


def test_a_new_hand_is_found_at_the_next_search() -> None:
    found, searched, _ = tracked([[STILL]] * 4 + [[STILL, MovingHand(600, 200)]] * 10)
    assert searched == [0, 10]
    assert [len(hands) for hands in found] == [1] * 10 + [2] * 4


def test_a_followed_hand_has_no_palm_score() -> None:
    first, second = tracked([[STILL]] * 2)[0]
    assert first[0].palm_score == 0.9
    assert second[0].palm_score is None


def test_the_palm_of_a_followed_hand_is_not_read() -> None:
    detector, reads = MediaPipeDetector(padding=1), ReadsMovingHands([STILL])
    palms = MovingPalms([STILL])
    vars(detector).update(find_palms=palms, read_hand=reads)
    tracker, state = HandTracker(detector, palms_every=1), None
    for _ in range(5):
        detections, state = tracker(FRAME, state)
        assert detections.dropped == ()
    assert (palms.calls, reads.calls) == (5, 5)


def test_a_moving_hand_is_followed() -> None:
    path = [[MovingHand(100 + 30 * step, 200 + 10 * step)] for step in range(10)]
    found, searched, _ = tracked(path, palms_every=100)
    assert searched == [0]
    for (hand,), (moving,) in zip(found, path, strict=True):
        np.testing.assert_array_equal(hand.landmarks_2d, moving.landmarks)


def test_two_squares_that_reach_the_same_hand_are_one_hand() -> None:
    # One of two hands passes the other and disappears behind it: both squares now hold the same hand.
    other = MovingHand(330, 200)
    found, _, dropped = tracked([[STILL, other], [MovingHand(265, 200)]])
    assert [len(hands) for hands in found] == [2, 1]
    assert any("a followed hand" in one and "found already" in one for one in dropped[1])


def test_hands_are_in_the_order_of_their_presence() -> None:
    faint, clear = MovingHand(200, 200, presence=0.7), MovingHand(600, 200, presence=0.9)
    for hands in tracked([[faint, clear], [clear, faint], [faint, clear]])[0]:
        assert [hand.score for hand in hands] == [0.9, 0.7]


def test_a_clip_continued_from_a_written_state_is_the_clip() -> None:
    path = [[MovingHand(100 + 7.3 * step, 200 + step / 3)] for step in range(8)]
    whole = tracked(path, palms_every=3)[0]
    detector = MediaPipeDetector(padding=1)
    written = TrackerState().to_json()
    for hands, expected in zip(path, whole, strict=True):
        vars(detector).update(find_palms=MovingPalms(hands), read_hand=ReadsMovingHands(hands))
        # Every frame starts anew: another tracker, and a state that was read back.
        detections, state = HandTracker(detector, 3)(FRAME, TrackerState.from_json(written))
        written = state.to_json()
        (hand,), (one,) = detections.hands, expected
        np.testing.assert_array_equal(hand.landmarks_2d, one.landmarks_2d)
        assert hand.sigma is not None
        np.testing.assert_array_equal(hand.sigma, one.sigma)


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.builds(Region, NUMBERS, NUMBERS, NUMBERS, NUMBERS), max_size=3).map(tuple),
    st.integers(0, 10**9),
    st.integers(0, AFTER_LOSS),
)
def test_a_state_is_read_back_as_it_was(
    regions: tuple[Region, ...], since: int, after: int
) -> None:
    state = TrackerState(regions, since, after)
    assert TrackerState.from_json(state.to_json()) == state
    assert "\n" not in state.to_json()


@pytest.mark.parametrize(
    "text",
    ["", "3", "[]", "{}", '{"squares": [[1, 2, 3]], "since_search": 0, "after_loss": 0}',
     '{"squares": [], "since_search": 1}', '{"squares": [], "since_search": 1, "after_loss": null}',
     '{"squares": [[1, 2, 3, "wide"]], "since_search": 0, "after_loss": 0}'],
)  # fmt: skip
def test_a_damaged_state_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"Expected the state of a tracker.*Start again"):
        TrackerState.from_json(text)


def test_no_frames_between_searches_are_refused() -> None:
    with pytest.raises(ValueError, match="palms_every of at least 1 frame, found 0"):
        HandTracker(MediaPipeDetector(), palms_every=0)


def test_the_square_of_the_next_frame_is_that_of_the_networks_landmarks(
    models: Path, two_hands: np.ndarray
) -> None:
    detector = MediaPipeDetector(models=models, copies=0)
    first, state = HandTracker(detector)(two_hands)
    # The first frame is a photograph: the same hands by the same bits, then by presence.
    alone = sorted(detector(two_hands).hands, key=lambda hand: -(hand.score or 0))
    for hand, expected, region in zip(first.hands, alone, state.regions, strict=True):
        np.testing.assert_array_equal(hand.landmarks_2d, expected.landmarks_2d)
        assert region == region_of_landmarks(hand.landmarks_2d)
    second, _ = HandTracker(detector)(two_hands, state)
    readings = [detector.read_hand(two_hands, region) for region in state.regions]
    by_presence = sorted(readings, key=lambda reading: -reading.presence)
    for hand, reading in zip(second.hands, by_presence, strict=True):
        np.testing.assert_array_equal(hand.landmarks_2d, reading.landmarks_2d)
        assert (hand.side, hand.palm_score) == ("left", None)


def test_a_copy_averages_followed_hands_too(models: Path, one_hand: np.ndarray) -> None:
    tracker = HandTracker(MediaPipeDetector(models=models), copies=1)
    _, state = tracker(one_hand)
    (hand,) = tracker(one_hand, state)[0].hands
    first: HandReading = tracker.detector.read_hand(one_hand, state.regions[0])
    second = tracker.detector.read_hand(one_hand, region_of_landmarks(first.landmarks_2d))
    np.testing.assert_allclose(hand.landmarks_2d, (first.landmarks_2d + second.landmarks_2d) / 2)
