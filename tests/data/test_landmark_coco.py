"""Landmark files in COCO's form, in all its variants."""

from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from tests.support.landmark_writing import (
    POINTS,
    SCORES,
    assert_same_hands,
    coco_hand,
    with_scores,
    written,
)


def test_coco_keypoints_come_with_their_images_and_sides(tmp_path: Path) -> None:
    visibility = np.tile([2, 1, 0], 7)
    content = {
        "images": [{"id": 7, "file_name": "x/a.jpg", "width": 640, "height": 480}],
        "categories": [{"id": 1, "name": "left_hand"}, {"id": 2, "name": "hand"}],
        "annotations": [
            {"id": 1, "image_id": 7, "category_id": 1, "keypoints": coco_hand(POINTS[0], visibility)},
            {"id": 2, "image_id": 8, "category_id": 2, "keypoints": coco_hand(POINTS[1], visibility)},
        ],
    }  # fmt: skip
    landmarks = read_landmarks(written(tmp_path, content))
    expected = POINTS[:2].copy()
    expected[:, 2::3] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.left.tolist() == [True, False]
    assert landmarks.names == ("x/a.jpg", "annotation 2")
    assert landmarks.images == (tmp_path / "x/a.jpg", None)
    # Visibility says nothing about the precision of a label.
    assert landmarks.confidence is None


def test_coco_wholebody_has_two_hands_and_those_that_are_not_valid_are_left_out(
    tmp_path: Path,
) -> None:
    seen, nothing = np.full(21, 2), np.zeros(21)
    people = [
        {
            "id": 1, "image_id": 3, "keypoints": [0] * 51,
            "lefthand_kpts": coco_hand(POINTS[0], seen), "lefthand_valid": True,
            "righthand_kpts": coco_hand(POINTS[1], seen), "righthand_valid": True,
        },
        {
            "id": 2, "image_id": 3, "keypoints": [0] * 51,
            "lefthand_kpts": coco_hand(POINTS[2], nothing), "lefthand_valid": False,
            "righthand_kpts": coco_hand(POINTS[2], seen), "righthand_valid": True,
        },
    ]  # fmt: skip
    content = {"images": [{"id": 3, "file_name": "b.jpg"}], "annotations": people}
    landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("b.jpg left", "b.jpg right", "b.jpg right")


def test_a_list_of_coco_results_has_scores(tmp_path: Path) -> None:
    scores = SCORES[0].copy()
    scores[0], scores[1] = 1.07, 0.0
    content = [
        {"image_id": 3, "category_id": 1, "score": 0.9, "keypoints": coco_hand(POINTS[0], scores)}
    ]
    landmarks = read_landmarks(written(tmp_path, content))
    assert landmarks.confidence is not None
    assert landmarks.confidence[0, 0] == 1.0
    assert landmarks.labelled[0].tolist() == [number != 1 for number in range(21)]


@pytest.mark.parametrize(("keypoints", "first"), [(133, 91), (136, 94)])
@pytest.mark.parametrize("nested", [True, False])
def test_the_hands_of_a_whole_body_are_found_by_their_place(
    tmp_path: Path, keypoints: int, first: int, nested: bool
) -> None:
    """COCO-WholeBody: left 91 to 111, right 112 to 132. Halpe: left 94 to 114, right 115 to 135."""
    bodies = np.zeros((2, keypoints, 3))
    bodies[0, first : first + 21] = with_scores()[0]
    bodies[0, first + 21 : first + 42] = with_scores()[1]
    bodies[1, first + 21 : first + 42] = with_scores()[2]
    # A hand that is not in the image is left out; the person's box is not used.
    people = [
        {
            "image_id": "a.jpg", "bbox": [0, 0, 900, 900],
            "keypoints": body.tolist() if nested else body.ravel().tolist(),
        }
        for body in bodies
    ]  # fmt: skip
    landmarks = read_landmarks(written(tmp_path, people))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("a.jpg left", "a.jpg right", "a.jpg right")
    assert landmarks.images == (tmp_path / "a.jpg",) * 3
    assert landmarks.hand_boxes is None


def test_boxes_come_with_their_hands_and_one_of_no_size_is_none(tmp_path: Path) -> None:
    seen = np.full(21, 2)
    people = [
        {
            "id": 1, "bbox": [1, 2, 3, 4],
            "lefthand_kpts": coco_hand(POINTS[0], seen), "lefthand_box": [10, 20, 30, 50],
            "righthand_kpts": coco_hand(POINTS[1], seen), "righthand_box": [0, 0, 0, 0],
        },
        {"id": 2, "keypoints": coco_hand(POINTS[2], seen), "bbox": [5.5, 6, 7, 8]},
    ]  # fmt: skip
    boxes = read_landmarks(written(tmp_path, {"annotations": people})).hand_boxes
    assert boxes is not None
    assert boxes[[0, 2]].tolist() == [[10, 20, 40, 70], [5.5, 6, 12.5, 14]]
    assert boxes[1].isnan().all()


def test_a_keypoint_of_visibility_one_is_labelled_and_hidden(tmp_path: Path) -> None:
    visibility = np.tile([2, 1, 0], 7)
    content = [{"keypoints": coco_hand(POINTS[0], visibility)}]
    landmarks = read_landmarks(written(tmp_path, content))
    assert landmarks.occluded is not None
    assert landmarks.labelled[0].tolist() == [True, True, False] * 7
    assert landmarks.occluded[0].tolist() == [False, True, False] * 7


def test_a_file_that_calls_every_keypoint_one_does_not_tell_what_is_hidden(tmp_path: Path) -> None:
    content = [{"keypoints": coco_hand(POINTS[0], np.ones(21))}]
    assert read_landmarks(written(tmp_path, content)).occluded is None


def test_hidden_keypoints_follow_the_order_of_the_landmarks(tmp_path: Path) -> None:
    """In RHD's order the tip of the thumb is number 1, in FreiHAND's it is 4."""
    visibility = np.full(21, 2)
    visibility[1] = 1
    path = written(tmp_path, [{"keypoints": coco_hand(POINTS[0], visibility)}])
    landmarks = read_landmarks(path, assumed=Assumptions(order="rhd"))
    assert landmarks.occluded is not None
    assert landmarks.occluded[0].nonzero().flatten().tolist() == [4]
    assert landmarks.landmarks_2d[0, 4].tolist() == POINTS[0, 1].tolist()
