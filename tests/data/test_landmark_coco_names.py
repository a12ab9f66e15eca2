"""Names of keypoints in COCO's files, and their persons without hands and image sizes."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from tests.support.landmark_writing import POINTS, assert_same_hands, coco_hand, written
from tests.support.tool_files import FILES


def test_names_of_keypoints_go_before_the_option_order(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Tip of the thumb first, as in RHD, but the file says so itself."""
    names = [
        "wrist",
        *(
            f"{finger}{number}"
            for finger in ("thumb", "forefinger", "middle_finger", "ring_finger", "pinky_finger")
            for number in (4, 3, 2, 1)
        ),
    ]
    order = [0, *(4 * finger + number for finger in range(5) for number in (4, 3, 2, 1))]
    content = {
        "categories": [{"id": 1, "name": "hand", "keypoints": names}],
        "annotations": [
            {"category_id": 1, "keypoints": coco_hand(hand[order], np.full(21, 2))}
            for hand in POINTS
        ],
    }
    assert_same_hands(read_landmarks(written(tmp_path, content)))
    assert not [record for record in caplog.records if record.levelno > logging.INFO]
    assert_same_hands(
        read_landmarks(written(tmp_path, content), assumed=Assumptions(order="interhand"))
    )
    assert "names its landmarks; order=interhand is not used" in caplog.text


def test_names_that_name_no_landmark_leave_the_order_to_the_option(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    content = {
        "categories": [
            {"id": 1, "name": "hand", "keypoints": [f"part {n:c}" for n in range(97, 118)]}
        ],
        "annotations": [{"category_id": 1, "keypoints": coco_hand(POINTS[0], np.full(21, 2))}],
    }
    landmarks = read_landmarks(written(tmp_path, content), assumed=Assumptions(order="interhand"))
    assert landmarks.landmarks_2d[0, 0].tolist() == POINTS[0, 20].tolist()
    assert "names of keypoints that name no landmark: ['part a', 'part b'" in caplog.text


def test_two_hands_among_named_keypoints_are_told_apart(tmp_path: Path) -> None:
    """InterHand2.6M's order: the right hand from tip to base, wrist last, then the left one."""
    fingers = ("thumb", "forefinger", "middle_finger", "ring_finger", "pinky_finger")
    one = [*(f"{finger}{number}" for finger in fingers for number in (4, 3, 2, 1)), "wrist"]
    order = [*(4 * finger + number for finger in range(5) for number in (4, 3, 2, 1)), 0]
    keypoints = np.concatenate([POINTS[1][order], POINTS[0][order]])
    content = {
        "categories": [
            {"id": 1, "keypoints": [f"{side}_{name}" for side in ("right", "left") for name in one]}
        ],
        "annotations": [
            {
                "category_id": 1,
                "keypoints": np.pad(keypoints, ((0, 0), (0, 1)), constant_values=2).tolist(),
            }
        ],
    }
    landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks, POINTS[[1, 0]])
    assert landmarks.left.tolist() == [False, True]


def test_persons_without_hands_are_left_out_of_coco_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    seen = np.full(21, 2)
    content = {
        "annotations": [
            {"id": 1, "keypoints": coco_hand(POINTS[0], seen)},
            {"id": 2, "keypoints": [1.0] * 51},
            {"id": 3, "bbox": [1, 2, 3, 4]},
            {"id": 4, "lefthand_kpts": [0] * 63, "lefthand_valid": False},
        ]
    }
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks, POINTS[:1])
    for counted in ("of 17 keypoints (1)", "without keypoints (1)", "marked as not valid (1)"):
        assert counted in caplog.text


def test_the_sizes_of_cocos_images_are_known(tmp_path: Path) -> None:
    content = json.loads(str(FILES["cvat coco"].content))
    landmarks = read_landmarks(written(tmp_path, content))
    assert landmarks.image_sizes is not None
    assert landmarks.image_sizes.tolist() == [[2000, 2000]] * 3
