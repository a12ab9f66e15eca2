"""Files that people wrote with other tools, from an optional folder: `HAND_RECON_MATERIAL` names it.

The same situations are tested on made-up files in `test_landmark_formats.py` and its siblings.
"""

import json
import logging
import os
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks

MATERIAL: Final = os.environ.get("HAND_RECON_MATERIAL")

pytestmark = pytest.mark.skipif(
    MATERIAL is None, reason="HAND_RECON_MATERIAL names no folder with cases/"
)


def case(name: str) -> Path:
    path = Path(MATERIAL or "") / "cases" / name
    if not path.is_file():
        pytest.skip(f"{path} is missing")
    return path


@pytest.mark.parametrize(
    ("name", "left", "right", "words"),
    [
        ("07-openpose/frame_000000000000_keypoints.json", 1, 1, "OpenPose's people"),
        ("08-mmpose-inferencer/result.json", 0, 3, "mmpose's predictions"),
        ("08b-mmpose-wholebody/result.json", 1, 1, "mmpose's predictions"),
        ("08c-mmpose-instance-info/result.json", 0, 1, "mmpose's predictions"),
        ("09-cvat-order/person_keypoints_default.json", 0, 6, "COCO's annotations"),
        ("10b-labelstudio-export/project-1.json", 0, 1, "Label Studio's keypoints"),
        ("11-labelme/a.json", 0, 1, "LabelMe's shapes"),
        ("12-dlc/videoDLC.csv", 0, 4, "DeepLabCut's table"),
        ("12d-csv-long/hands.csv", 0, 6, "numbered anew in each image"),
        ("15c-133/hands.json", 1, 1, "bodies of 133 keypoints (1)"),
        ("16f-frames/hands.json", 0, 3, "lists of hands for each frame"),
        ("25-coco-mixed/ann.json", 0, 2, "left out: annotations of 17 keypoints (1)"),
        ("25b-wholebody/ann.json", 0, 1, "annotations of 17 keypoints (1)"),
    ],
)
def test_a_case_is_read_with_all_of_its_hands(
    caplog: pytest.LogCaptureFixture, name: str, left: int, right: int, words: str
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(case(name))
    assert int(landmarks.left.sum()) == left
    assert len(landmarks) == left + right
    assert landmarks.labelled.all()
    assert words in caplog.text


def test_the_names_of_cvats_keypoints_put_them_into_order() -> None:
    path = case("09-cvat-order/person_keypoints_default.json")
    content = json.loads(path.read_text())
    names = content["categories"][0]["keypoints"]
    first = np.reshape(content["annotations"][0]["keypoints"], (21, 3))
    landmarks = read_landmarks(path)
    for landmark, name in ((0, "wrist"), (4, "thumb_tip"), (5, "index_MCP"), (20, "little_tip")):
        expected = first[names.index(name), :2].tolist()
        assert landmarks.landmarks_2d[0, landmark].tolist() == expected


def test_the_hands_of_a_body_are_its_keypoints_91_to_132() -> None:
    path = case("15c-133/hands.json")
    body = np.array(json.loads(path.read_text())[0])
    both = read_landmarks(path).landmarks_2d.numpy().reshape(42, 2)
    np.testing.assert_array_equal(both, body[91:133])


def test_mediapipes_results_are_read_once_the_size_is_given() -> None:
    path = case("06-mediapipe-tasks/result.json")
    points = json.loads(path.read_text())["landmarks"][0]
    landmarks = read_landmarks(path, image_size=(640, 480))
    np.testing.assert_allclose(
        landmarks.landmarks_2d[0].numpy(), [[640 * p["x"], 480 * p["y"]] for p in points]
    )
    assert landmarks.left.tolist() == [False]
    with pytest.raises(ValueError, match=r"image_size=\[width,height\]"):
        read_landmarks(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("06c-mediapipe-world/hands.json", "3D points in metres"),
        ("15b-openxr-26/hands.json", "has 26 points, expected 21"),
    ],
)
def test_a_case_that_has_no_hands_in_the_image_is_refused_with_the_cure(
    name: str, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        read_landmarks(case(name))
