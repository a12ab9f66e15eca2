"""Landmark files in JSON: every form gives the same hands."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import mirror_left
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARKS
from tests.support.landmark_writing import (
    CAMERA,
    POINTS,
    SCORES,
    assert_same_hands,
    with_scores,
    written,
)

# Outside the image too, but not all of them within ±2, which would not be pixels.
numbers = st.floats(-500, -3) | st.floats(3, 8000)
points = st.none() | st.tuples(numbers, numbers).map(list)
files_of_hands = st.lists(st.lists(points, min_size=21, max_size=21), min_size=1, max_size=4)


@given(files_of_hands)
def test_every_list_of_hands_comes_back_number_for_number(
    tmp_path_factory: pytest.TempPathFactory, hands: list[list[list[float] | None]]
) -> None:
    path = written(tmp_path_factory.mktemp("json"), hands)
    landmarks = read_landmarks(path)
    for hand, (points, labelled) in enumerate(
        zip(landmarks.landmarks_2d.tolist(), landmarks.labelled.tolist(), strict=True)
    ):
        back = [point if there else None for point, there in zip(points, labelled, strict=True)]
        assert back == hands[hand]


def test_a_single_hand_need_not_be_nested(tmp_path: Path) -> None:
    one: list[Any] = POINTS[0].tolist()
    one[4] = None
    landmarks = read_landmarks(written(tmp_path, one))
    assert len(landmarks) == 1
    assert landmarks.labelled[0].tolist() == [number != 4 for number in range(21)]


@pytest.mark.parametrize("missing", [None, [None, None], [None, None, None], [float("nan")] * 2])
def test_a_missing_landmark_can_be_written_in_any_of_these_ways(
    tmp_path: Path, missing: list[None] | None
) -> None:
    hands = with_scores()
    hands[1][20] = missing
    landmarks = read_landmarks(written(tmp_path, hands))
    expected = POINTS.copy()
    expected[1, 20] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.confidence is not None
    assert landmarks.confidence.isnan().nonzero().tolist() == [[1, 20]]


def test_a_hand_that_was_not_found_keeps_its_place(tmp_path: Path) -> None:
    landmarks = read_landmarks(written(tmp_path, [POINTS[0].tolist(), None, POINTS[2].tolist()]))
    assert landmarks.labelled.sum(dim=1).tolist() == [21, 0, 21]
    assert landmarks.usable.tolist() == [True, False, True]


def test_third_numbers_up_to_one_are_confidences_and_the_log_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, with_scores()))
    assert "all lie in [0, 1] and are read as confidences" in caplog.text
    assert landmarks.sigma is None
    assert landmarks.confidence is not None
    np.testing.assert_array_equal(landmarks.confidence.numpy(), SCORES)


def test_third_numbers_above_one_are_sigmas_and_the_log_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, with_scores(third_value=SCORES * 9)))
    assert "read as standard deviations in pixels" in caplog.text
    assert landmarks.confidence is None
    assert landmarks.sigma is not None
    np.testing.assert_array_equal(landmarks.sigma.numpy(), SCORES * 9)


def test_the_caller_can_say_that_small_numbers_are_sigmas(tmp_path: Path) -> None:
    landmarks = read_landmarks(
        written(tmp_path, with_scores()), assumed=Assumptions(third_value="sigma")
    )
    assert landmarks.confidence is None
    assert landmarks.sigma is not None


def test_a_landmark_of_no_confidence_is_missing(tmp_path: Path) -> None:
    hands = with_scores()
    hands[2][7] = [0, 0, 0]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert (~landmarks.labelled).nonzero().tolist() == [[2, 7]]
    assert landmarks.landmarks_2d[2, 7].isnan().all()


def test_another_order_of_landmarks_is_put_right(tmp_path: Path) -> None:
    order = [LANDMARKS.index(name) for name in LANDMARK_ORDERS["interhand"]]
    shuffled = with_scores(POINTS[:, order], SCORES[:, order])
    for third in ("confidence", "sigma"):
        assumed = Assumptions(third_value=third, order="interhand")
        landmarks = read_landmarks(written(tmp_path, shuffled), assumed=assumed)
        assert_same_hands(landmarks)
        told = landmarks.sigma if third == "sigma" else landmarks.confidence
        assert told is not None
        np.testing.assert_array_equal(told.numpy(), SCORES)


def test_what_is_not_told_is_assumed_by_name(tmp_path: Path) -> None:
    path = written(tmp_path, POINTS.tolist())
    assert not read_landmarks(path).left.any()
    assert read_landmarks(path, assumed=Assumptions(side="left")).left.all()
    assert read_landmarks(path).names == ("0", "1", "2")
    with pytest.raises(ValueError, match="Unknown third value 'variance'; choose one of"):
        Assumptions(third_value="variance")
    with pytest.raises(ValueError, match="Unknown side 'both'; choose one of"):
        Assumptions(side="both")
    with pytest.raises(ValueError, match="Unknown landmark order 'mine'"):
        Assumptions(order="mine")


def test_objects_tell_side_image_and_camera(tmp_path: Path) -> None:
    hands = [
        {"landmarks": POINTS[0].tolist(), "side": "Left", "image": "a.jpg", "K": CAMERA},
        {"landmarks_2d": POINTS[1].tolist(), "handedness": "right", "intrinsics": CAMERA},
        {"landmarks": POINTS[2].tolist(), "name": "third", "K": CAMERA, "sigma": [2.5] * 21},
    ]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("a.jpg", "1", "third")
    assert landmarks.images == (tmp_path / "a.jpg", None, None)
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA] * 3
    assert landmarks.sigma is not None
    assert landmarks.sigma[:2].isnan().all()
    assert (landmarks.sigma[2] == 2.5).all()


def test_one_object_is_one_hand_and_images_may_lie_elsewhere(tmp_path: Path) -> None:
    path = written(tmp_path, {"landmarks": POINTS[0].tolist(), "image": "a.jpg"})
    landmarks = read_landmarks(path, assumed=Assumptions(images=Path("/images")))
    assert landmarks.images == (Path("/images/a.jpg"),)


def test_keys_that_are_not_read_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_landmarks(written(tmp_path, [{"landmarks": POINTS[0].tolist(), "colour": "blue"}]))
    assert "['colour'] are not read; known are" in caplog.text


def test_objects_can_tell_the_box_and_what_is_hidden(tmp_path: Path) -> None:
    hidden = [number % 3 == 0 for number in range(21)]
    hands = [
        {"landmarks": POINTS[0].tolist(), "box": [1, 2, 30, 40], "occluded": hidden},
        {"landmarks": POINTS[1].tolist(), "occluded": [False] * 21},
    ]
    landmarks = read_landmarks(written(tmp_path, hands))
    assert landmarks.hand_boxes is not None
    assert landmarks.occluded is not None
    assert landmarks.hand_boxes[0].tolist() == [1, 2, 30, 40]
    assert landmarks.hand_boxes[1].isnan().all()
    assert landmarks.occluded.tolist() == [hidden, [False] * 21]
    chosen = landmarks.select(torch.tensor([1, 0]))
    assert chosen.occluded is not None
    assert chosen.occluded.tolist() == [[False] * 21, hidden]
    assert chosen.hand_boxes is not None
    assert chosen.hand_boxes[1].tolist() == [1, 2, 30, 40]


def test_what_is_hidden_is_used_only_where_every_hand_tells(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    hands = [
        {"landmarks": POINTS[0].tolist(), "occluded": [True] * 21},
        {"landmarks": POINTS[1].tolist()},
    ]
    assert read_landmarks(written(tmp_path, hands)).occluded is None
    assert "1 of 2 hands have `occluded`" in caplog.text


def test_a_mirrored_hand_has_its_box_mirrored(tmp_path: Path) -> None:
    """The axis is the middle of the labels, u = 50: what was 10 left of it is 10 right of it."""
    points: list[list[float]] = [[20.0, 5.0]] + [[80.0, 95.0]] * 20
    hand = {"landmarks": points, "side": "left", "box": [40, 0, 90, 100]}
    boxes = mirror_left(read_landmarks(written(tmp_path, [hand]))).hand_boxes
    assert boxes is not None
    assert boxes.tolist() == [[10, 0, 60, 100]]


def test_hands_of_unknown_side_can_be_refused(tmp_path: Path) -> None:
    hands = [{"landmarks": POINTS[0].tolist(), "side": "left"}, {"landmarks": POINTS[1].tolist()}]
    with pytest.raises(ValueError, match=r"gives no side for 1 of 2 hands.*data\.side"):
        read_landmarks(written(tmp_path, hands), assumed=Assumptions(side=None))
