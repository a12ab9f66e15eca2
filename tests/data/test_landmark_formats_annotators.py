"""Files of annotation tools: LabelMe, Label Studio and CVAT."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.annotation_files import (
    SIZE,
    cvat_images,
    cvat_video,
    label_studio_task,
    labelme,
)
from tests.support.landmark_writing import POINTS, assert_same_hands, written


def test_labelme_points_without_group_are_one_hand(tmp_path: Path) -> None:
    content = labelme(range(1, 2))
    for shape in content["shapes"]:
        shape["group_id"] = None
        shape["label"] = shape["label"].removeprefix("right ")
    landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks, POINTS[1:2])
    assert landmarks.names == ("a.jpg",)
    assert landmarks.image_sizes is not None
    assert landmarks.image_sizes.tolist() == [[2000, 2000]]


def test_two_hands_of_labelme_without_groups_are_refused_with_the_cure(tmp_path: Path) -> None:
    content = labelme(range(1, 3))
    for shape in content["shapes"]:
        shape["group_id"] = None
    with pytest.raises(ValueError, match=r"two points 'right wrist' of one hand.*a group id"):
        read_landmarks(written(tmp_path, content))


def test_labelme_labels_may_be_numbers_and_a_missing_one_is_missing(tmp_path: Path) -> None:
    content = labelme(range(1, 2))
    for landmark, shape in enumerate(content["shapes"]):
        shape["label"] = str(landmark)
    del content["shapes"][7]
    landmarks = read_landmarks(written(tmp_path, content))
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 7]]
    assert landmarks.landmarks_2d[0, 8].tolist() == POINTS[1, 8].tolist()


def test_numbers_that_may_count_from_zero_or_one_are_refused(tmp_path: Path) -> None:
    content = labelme(range(1, 2))
    content["shapes"] = content["shapes"][:20]
    for number, shape in enumerate(content["shapes"], start=1):
        shape["label"] = str(number)
    with pytest.raises(ValueError, match="none of its labels names a landmark"):
        read_landmarks(written(tmp_path, content))


def test_other_labels_and_shapes_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    content = labelme(range(1, 2))
    box: dict[str, Any] = {"label": "hand", "points": [[1, 2], [3, 4]], "shape_type": "rectangle"}
    content["shapes"] += [box, {"label": "ring box", "points": [[5, 6]], "shape_type": "point"}]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, content))
    assert_same_hands(landmarks, POINTS[1:2])
    assert "left out: shapes that are no points (1), points of other labels (1)" in caplog.text


def test_flags_of_labelme_tell_the_side_and_windows_paths_are_read(tmp_path: Path) -> None:
    content = labelme(range(1, 2))
    content["imagePath"] = "..\\images\\a.jpg"
    for shape in content["shapes"]:
        shape["label"] = shape["label"].removeprefix("right ")
        shape["flags"] = {"left": True, "right": False}
    landmarks = read_landmarks(written(tmp_path, content))
    assert landmarks.left.tolist() == [True]
    assert landmarks.names == ("../images/a.jpg left",) or landmarks.names == ("../images/a.jpg",)


def test_a_line_of_21_points_is_a_hand_in_order(tmp_path: Path) -> None:
    shape = {"label": "left hand", "points": POINTS[0].tolist(), "shape_type": "linestrip"}
    landmarks = read_landmarks(written(tmp_path, {"shapes": [shape], "imagePath": "a.jpg"}))
    assert_same_hands(landmarks, POINTS[:1])
    assert landmarks.left.tolist() == [True]


def test_labels_that_name_no_landmark_are_shown(tmp_path: Path) -> None:
    content = {"shapes": [{"label": "nose", "points": [[1, 2]]}], "imagePath": "a.jpg"}
    with pytest.raises(ValueError, match=r"none of its labels names a landmark.*'nose'.*thumb CMC"):
        read_landmarks(written(tmp_path, content))


@pytest.mark.parametrize(
    ("address", "name"),
    [
        ("/data/upload/1/0f1e2d3c-a.jpg", "0f1e2d3c-a.jpg"),
        ("/data/local-files/?d=hands/a.jpg", "hands/a.jpg"),
        ("https://example.org/x/a%20b.jpg?token=1", "a b.jpg"),
        ("s3://bucket/x/a.jpg", "a.jpg"),
        ("what?.jpg", "what?.jpg"),
    ],
)
def test_label_studios_addresses_end_in_a_file_name(
    tmp_path: Path, address: str, name: str
) -> None:
    task = label_studio_task(1)
    task["data"] = {"image": address}
    assert read_landmarks(written(tmp_path, [task])).names == (name,)


def test_percents_of_label_studio_are_of_the_original_size(tmp_path: Path) -> None:
    """50 % and 25 % of 640 × 480 are 320 and 120 pixels."""
    task = label_studio_task(1)
    for region in task["annotations"][0]["result"]:
        region |= {"original_width": 640, "original_height": 480}
    task["annotations"][0]["result"][0]["value"] |= {"x": 50, "y": 25}
    landmarks = read_landmarks(written(tmp_path, [task]))
    assert landmarks.landmarks_2d[0, 0].tolist() == [320, 120]


def test_of_several_annotations_of_a_task_the_first_that_was_not_cancelled_is_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    task, other = label_studio_task(1), label_studio_task(0)
    cancelled = {"was_cancelled": True, "result": other["annotations"][0]["result"]}
    task["annotations"] = [cancelled, *task["annotations"], *other["annotations"]]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, [task]))
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), POINTS[1:2])
    assert "further annotations of a task (1)" in caplog.text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image_rotation": 90}, "turned by 90 degrees.*Turn the image file"),
        ({"original_width": None}, "expected `original_width` and `original_height`"),
        ({"value": {"x": "a", "y": 1, "keypointlabels": ["wrist"]}}, "expected 2 numbers"),
    ],
)
def test_label_studios_keypoints_that_cannot_be_placed_are_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    task = label_studio_task(1)
    task["annotations"][0]["result"][3] |= change
    with pytest.raises(ValueError, match=message):
        read_landmarks(written(tmp_path, [task]))


def test_points_of_a_cvat_skeleton_outside_are_missing_and_occluded_ones_marked(
    tmp_path: Path,
) -> None:
    text = cvat_images()
    text = text.replace('label="3" source="manual" outside="0"', 'label="3" outside="1"')
    text = text.replace(
        'label="5" source="manual" outside="0" occluded="0"', 'label="5" occluded="1"'
    )
    landmarks = read_landmarks(written(tmp_path, text, "annotations.xml"))
    assert (~landmarks.labelled).nonzero().tolist() == [[hand, 2] for hand in range(3)]
    assert landmarks.occluded is not None
    assert landmarks.occluded.nonzero().tolist() == [[hand, 4] for hand in range(3)]
    assert landmarks.names == ("0.jpg", "1.jpg", "2.jpg")
    assert landmarks.image_sizes is not None
    assert landmarks.image_sizes.tolist() == [list(SIZE)] * 3


def test_single_points_of_cvat_are_told_apart_by_their_group(tmp_path: Path) -> None:
    points = "".join(
        f'<points label="{name}" points="{POINTS[hand, landmark, 0]},{POINTS[hand, landmark, 1]}" '
        f'group_id="{hand + 1}"/>'
        for hand in range(2)
        for landmark, name in enumerate(LANDMARKS)
    )
    xml = f'<annotations><image name="a.jpg" width="9" height="9">{points}</image></annotations>'
    landmarks = read_landmarks(written(tmp_path, xml, "a.xml"))
    assert_same_hands(landmarks, POINTS[:2])
    assert landmarks.names == ("a.jpg group 1", "a.jpg group 2")
    with pytest.raises(ValueError, match=r"two points 'wrist' of one hand.*Group the points"):
        read_landmarks(written(tmp_path, xml.replace('group_id="2"', 'group_id="1"'), "b.xml"))


def test_frames_of_a_cvat_track_are_hands_of_their_own(tmp_path: Path) -> None:
    skeleton = cvat_images().partition("<skeleton")[2].partition("</skeleton>")[0].partition(">")[2]
    frames = "".join(f'<skeleton frame="{n}">{skeleton}</skeleton>' for n in (2, 3))
    xml = f'<annotations><track id="8" label="left_hand">{frames}</track></annotations>'
    landmarks = read_landmarks(written(tmp_path, xml, "a.xml"))
    assert landmarks.names == ("frame 2, track 8", "frame 3, track 8")
    assert landmarks.left.all()
    assert_same_hands(landmarks, POINTS[[0, 0]])


def test_an_attribute_of_cvat_tells_the_side_if_it_is_called_so(tmp_path: Path) -> None:
    xml = cvat_images().replace("left hand", "hand").replace("right hand", "hand")
    for name, expected in (("side", True), ("Handedness", True), ("camera", False)):
        attribute = f'<attribute name="{name}">Left</attribute></skeleton>'
        path = written(tmp_path, xml.replace("</skeleton>", attribute), "a.xml")
        assert read_landmarks(path).left.tolist() == [expected] * 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (cvat_images()[:-30], "not complete XML .*export it again"),
        ("<svg></svg>", r"XML of <svg>; expected CVAT's <annotations>"),
        ("<annotations></annotations>", "CVAT's XML and holds no hands"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><annotations>&b;</annotations>', "declarations of its own"),
        (cvat_video().replace(";", " "), "expected pairs|expected n × n numbers"),
        (cvat_video().partition(";")[0] + ';1,2"/></track></annotations>', "has 2 points; expected 21"),
        ('<annotations><image name="a"><points label="x" points=""/></image></annotations>', "pairs `u,v`"),
        ('<annotations><image name="a" width="w"></image></annotations>', "the image's size is"),
    ],
)  # fmt: skip
def test_mistakes_in_cvats_xml_have_their_message(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(written(tmp_path, text, "a.xml"))
