"""The whole detector: on photographs with the published models, and on made-up palms without them."""

import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hand_recon.detection.detector import DetectedHand, Detector
from hand_recon.detection.hands import HandReading
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.palms import Palm
from hand_recon.detection.regions import Region
from tests.detection.conftest import read


@pytest.fixture(scope="session")
def detector(models: Path) -> MediaPipeDetector:
    return MediaPipeDetector(models=models)


def distance(one: DetectedHand, landmarks: np.ndarray) -> float:
    """Mean distance of landmarks, shares of the hand's extent."""
    extent = np.ptp(landmarks, axis=0).max()
    return float(np.linalg.norm(one.landmarks_2d - landmarks, axis=1).mean() / extent)


def test_both_hands_are_found_once(detector: MediaPipeDetector, two_hands: np.ndarray) -> None:
    found = detector(two_hands)
    assert [hand.side for hand in found.hands] == ["left", "left"]
    assert all((hand.score or 0) > 0.9 and hand.side_score > 0.9 for hand in found.hands)
    assert all((hand.palm_score or 0) > 0.9 for hand in found.hands)
    # One points up, one down: wrist below and above the middle finger's tip.
    downward = {bool(hand.landmarks_2d[12, 1] > hand.landmarks_2d[0, 1]) for hand in found.hands}
    assert downward == {False, True}


def test_landmarks_are_where_the_hand_is(detector: MediaPipeDetector, one_hand: np.ndarray) -> None:
    (hand,) = detector(one_hand).hands
    assert hand.side == "right"
    # Read off the photograph by eye, pixels: wrist, tips of thumb, index and middle finger.
    expected = np.array([[53, 86], [81, 44], [55, 19], [34, 15]])
    found = hand.landmarks_2d[[0, 4, 8, 12]]
    assert np.linalg.norm(found - expected, axis=1).max() < 6
    # Ring and little finger are bent: their tips are below their PIPs.
    assert hand.landmarks_2d[16, 1] > hand.landmarks_2d[14, 1]
    assert hand.landmarks_3d is not None
    # Metres: a palm's length is 7 to 12 cm.
    assert 0.07 < np.linalg.norm(hand.landmarks_3d[9] - hand.landmarks_3d[0]) < 0.12


def test_a_mirrored_photograph_shows_the_other_side_at_mirrored_places(
    detector: MediaPipeDetector, one_hand: np.ndarray, two_hands: np.ndarray
) -> None:
    for image, side in ((one_hand, "left"), (two_hands, "right")):
        mirrored = detector(np.ascontiguousarray(image[:, ::-1]))
        assert {hand.side for hand in mirrored.hands} == {side}
        originals = detector(image).hands
        assert len(mirrored.hands) == len(originals)
        for hand in mirrored.hands:
            back = hand.landmarks_2d * [-1, 1] + [image.shape[1] - 1, 0]
            assert min(distance(one, back) for one in originals) < 0.04


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_rotated_photograph_gives_rotated_landmarks(
    detector: MediaPipeDetector, one_hand: np.ndarray, quarters: int
) -> None:
    (upright,) = detector(one_hand).hands
    (rotated,) = detector(np.ascontiguousarray(np.rot90(one_hand, quarters))).hands
    back = rotated.landmarks_2d
    for _ in range(quarters):
        # Undoes one counter-clockwise quarter: (x, y) comes from (width − 1 − y, x).
        back = np.stack([99 - back[:, 1], back[:, 0]], axis=1)
    assert one_hand.shape == (100, 100, 3)
    assert distance(upright, back) < 0.06
    assert rotated.side == "right"


def test_a_hand_in_a_corner_of_a_large_image_keeps_its_place(
    detector: MediaPipeDetector, one_hand: np.ndarray
) -> None:
    large = np.full((240, 320, 3), 190, dtype=np.uint8)
    large[130:230, 200:300] = one_hand
    (alone,), (placed,) = detector(one_hand).hands, detector(large).hands
    assert distance(placed, alone.landmarks_2d + np.array([200, 130])) < 0.06


@pytest.mark.parametrize("level", [0, 127, 255])
def test_a_blank_image_has_no_hands(detector: MediaPipeDetector, level: int) -> None:
    assert detector(np.full((120, 200, 3), level, dtype=np.uint8)).hands == ()


@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (2, 2), (3000, 10)])
def test_images_of_every_shape_are_looked_at(
    detector: MediaPipeDetector, shape: tuple[int, int]
) -> None:
    assert detector(np.zeros((*shape, 3), dtype=np.uint8)).hands == ()


def test_calls_do_not_influence_each_other(
    detector: MediaPipeDetector, one_hand: np.ndarray, two_hands: np.ndarray
) -> None:
    first = detector(one_hand).hands[0].landmarks_2d.copy()
    detector(two_hands)
    np.testing.assert_array_equal(detector(one_hand).hands[0].landmarks_2d, first)


def test_two_threads_find_the_same_hand(
    detector: MediaPipeDetector, models: Path, one_hand: np.ndarray
) -> None:
    (hand,) = MediaPipeDetector(models=models, threads=2)(one_hand).hands
    assert distance(detector(one_hand).hands[0], hand.landmarks_2d) < 1e-3


def test_padding_finds_a_hand_that_fills_the_image(models: Path, one_hand: np.ndarray) -> None:
    tight = np.ascontiguousarray(one_hand[10:92, 28:90])
    padded = MediaPipeDetector(models=models, padding=1.7)(tight)
    automatic = MediaPipeDetector(models=models)(tight)
    assert len(padded.hands) == len(automatic.hands) == 1
    (whole,) = MediaPipeDetector(models=models)(one_hand).hands
    assert distance(whole, padded.hands[0].landmarks_2d + np.array([28, 10])) < 0.06


def test_agrees_with_labels_that_mediapipe_made(models: Path) -> None:
    material = os.environ.get("HAND_RECON_MATERIAL")
    if not material:
        pytest.skip("needs photographs with labels: $HAND_RECON_MATERIAL/pictures")
    folder = Path(material) / "pictures"
    rows = json.loads((folder / "test.json").read_text())[::40]
    # The labels were made on padded copies, from one look at each hand.
    detector = MediaPipeDetector(
        models=models, padding=1.7, min_palm_score=0.4, max_hands=2, copies=0
    )
    errors = []
    for row in rows:
        image = read(folder / row["image"])
        (hand,) = detector(image).hands
        assert hand.side == row["side"]
        offset = np.linalg.norm(hand.landmarks_2d - np.array(row["landmarks"]), axis=1).mean()
        errors.append(offset * 256 / max(image.shape[:2]))
    # Small images were enlarged by another interpolation before they were labelled.
    assert np.median(errors) < 0.6


class FakePalms:
    """Palms of given scores, 100 px apart; the second look repeats them."""

    def __init__(self, *scores: float, step: float = 100.0) -> None:
        self.palms = [
            Palm(np.array([0.0, 0, 40, 40]) + step * index, np.zeros((7, 2)), score)
            for index, score in enumerate(scores)
        ]
        self.paddings: list[float] = []

    def __call__(self, image: np.ndarray, least: float, padding: float = 1.0) -> list[Palm]:
        self.paddings.append(padding)
        return self.palms


class FakeHands:
    """A hand at every square's centre."""

    def __init__(
        self, presence: float = 0.9, extent: float = 30.0, at: float | None = None
    ) -> None:
        self.presence, self.extent, self.at = presence, extent, at

    def __call__(self, image: np.ndarray, region: Region) -> HandReading:
        middle = np.array([region.x, region.y]) if self.at is None else np.full(2, self.at)
        landmarks = middle + np.linspace(0, self.extent, 21)[:, None]
        return HandReading(landmarks, np.zeros((21, 3)), self.presence, 0.9)


def faked(palms: FakePalms, hands: FakeHands, **options: float | str) -> MediaPipeDetector:
    detector = MediaPipeDetector(**options)  # type: ignore[arg-type]  # each test's own
    vars(detector).update(find_palms=palms, read_hand=hands)
    return detector


IMAGE = np.zeros((400, 400, 3), dtype=np.uint8)


def test_a_low_palm_score_is_named_with_its_option() -> None:
    found = faked(FakePalms(0.31), FakeHands())(IMAGE)
    assert found.hands == ()
    assert found.dropped == ("a palm of score 0.31 is below detector.min_palm_score=0.5",)


def test_a_low_presence_is_named_with_its_option() -> None:
    found = faked(FakePalms(0.8), FakeHands(presence=0.42))(IMAGE)
    assert found.hands == ()
    (sentence,) = found.dropped
    assert "has presence 0.42, not above detector.min_presence=0.5" in sentence


def test_a_presence_at_the_threshold_is_not_enough() -> None:
    assert not faked(FakePalms(0.8), FakeHands(presence=0.5))(IMAGE).hands
    assert faked(FakePalms(0.8), FakeHands(presence=0.5), min_presence=0.49)(IMAGE).hands


def test_a_tiny_hand_is_dropped_aloud() -> None:
    found = faked(FakePalms(0.8), FakeHands(extent=12))(IMAGE)
    (sentence,) = found.dropped
    assert "spans 12 px, below detector.min_side=20" in sentence
    assert len(faked(FakePalms(0.8), FakeHands(extent=12), min_side=0)(IMAGE).hands) == 1


def test_the_best_hands_are_kept_up_to_the_limit() -> None:
    found = faked(FakePalms(0.7, 0.9, 0.8), FakeHands(), max_hands=2)(IMAGE)
    assert [hand.palm_score for hand in found.hands] == [0.9, 0.8]
    assert found.dropped == ("a palm of score 0.70 is one more than detector.max_hands=2",)
    assert len(faked(FakePalms(0.7, 0.9, 0.8), FakeHands())(IMAGE).hands) == 3


def test_two_palms_of_one_hand_are_one_hand() -> None:
    found = faked(FakePalms(0.9, 0.8), FakeHands(at=50.0))(IMAGE)
    assert [hand.palm_score for hand in found.hands] == [0.9]
    (sentence,) = found.dropped
    assert "is of a hand that was found already" in sentence


@pytest.mark.parametrize(
    ("padding", "looks"), [("auto", [1.0, 1.7]), (1, [1.0]), (1.7, [1.7]), (2, [2.0])]
)
def test_palms_are_looked_for_with_every_padding(padding: float | str, looks: list[float]) -> None:
    palms = FakePalms(0.9)
    found = faked(palms, FakeHands(), padding=padding)(IMAGE)
    assert palms.paddings == looks
    # A palm that both looks find is one hand, and nothing is said about it.
    assert len(found.hands) == 1
    assert found.dropped == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"min_palm_score": 1.2}, r"detector.min_palm_score between 0 and 1, found 1.2"),
        ({"min_presence": -0.1}, r"detector.min_presence between 0 and 1, found -0.1"),
        ({"min_side": -1.0}, r"detector.min_side of at least 0 pixels, found -1"),
        ({"max_hands": 0}, r"detector.max_hands of at least 1, or null for all hands, found 0"),
        ({"threads": 0}, r"detector.threads of at least 1, found 0"),
        ({"padding": 0.5}, r"detector.padding=auto or a number from 1 \(none\) to 10, found 0.5"),
        ({"padding": "wide"}, r"found wide"),
        ({"padding": float("nan")}, r"found nan"),
    ],
)
def test_an_option_out_of_range_is_refused_at_once(options: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MediaPipeDetector(**options)  # type: ignore[arg-type]  # wrong on purpose


def test_it_is_a_detector(one_hand: np.ndarray) -> None:
    detector: Detector = faked(FakePalms(0.9), FakeHands())
    assert detector.name == "mediapipe"
    hand = detector(one_hand, Path("hand.jpg")).hands[0]
    assert replace(hand, score=0.1).score == 0.1


def test_opencv_and_rgb_are_not_confused(detector: MediaPipeDetector, one_hand: np.ndarray) -> None:
    # Blue hands are hands, too, but not equally certain: the order of channels matters.
    swapped = np.ascontiguousarray(cv2.cvtColor(one_hand, cv2.COLOR_RGB2BGR))
    palms = [one.score for one in detector.find_palms(one_hand, 0.2)]
    assert palms != [one.score for one in detector.find_palms(swapped, 0.2)]
