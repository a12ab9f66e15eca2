"""Folders of landmark files, and YOLO's labels beside their images."""

import json
import logging
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.annotation_files import SIZE, labelme, yolo_labels
from tests.support.landmark_writing import POINTS, SCORES, assert_same_hands, with_scores, written
from tests.support.tool_files import mediapipe, people


def test_the_files_of_openpose_are_read_in_the_order_of_their_numbers(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Frame 10 comes after frame 2, unlike their names; a frame without people has no hands."""
    for number, found in ((2, people()[:1]), (10, people()[1:]), (3, [])):
        written(tmp_path, {"people": found}, f"frame_{number}_keypoints.json")
    (tmp_path / "notes.md").write_text("not read")
    (tmp_path / "deeper").mkdir()
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(tmp_path)
    assert_same_hands(landmarks)
    assert landmarks.names == (
        "frame_2_keypoints person 0 left",
        "frame_2_keypoints person 0 right",
        "frame_10_keypoints person 0 right",
    )
    assert landmarks.confidence is not None
    np.testing.assert_array_equal(landmarks.confidence.numpy(), SCORES)
    assert "2 files of OpenPose's people; 1 left and 2 right hands are read" in caplog.text
    assert "left out: files without hands (1), hands that were not found (1)" in caplog.text


def test_the_files_of_labelme_find_their_images_in_the_folder(tmp_path: Path) -> None:
    Image.new("L", (3, 2)).save(tmp_path / "b.jpg")
    for hand, name in ((0, "a"), (1, "b")):
        content = labelme(range(hand, hand + 1))
        content["imagePath"] = f"{name}.jpg"
        written(tmp_path, content, f"{name}.json")
    landmarks = read_landmarks(tmp_path)
    assert_same_hands(landmarks, POINTS[:2])
    assert landmarks.names == ("a.jpg", "b.jpg")
    assert landmarks.images == (tmp_path / "a.jpg", tmp_path / "b.jpg")


def test_what_some_files_lack_is_unknown_for_their_hands(tmp_path: Path) -> None:
    written(
        tmp_path, [{"landmarks": POINTS[0].tolist(), "sigma": [2.0] * 21, "name": "x"}], "a.json"
    )
    written(tmp_path, [{"landmarks": with_scores()[1], "side": "left"}], "b.json")
    landmarks = read_landmarks(tmp_path)
    assert_same_hands(landmarks, POINTS[:2])
    assert landmarks.names == ("a x", "b 0")
    assert landmarks.left.tolist() == [False, True]
    assert landmarks.sigma is not None
    assert landmarks.confidence is not None
    assert landmarks.sigma[1].isnan().all()
    assert landmarks.confidence[0].isnan().all()


def test_files_of_several_forms_are_refused(tmp_path: Path) -> None:
    written(tmp_path, labelme(), "a.json")
    written(tmp_path, {"people": people()}, "b.json")
    with pytest.raises(
        ValueError, match=r"a\.json holds LabelMe's shapes, b\.json OpenPose's people"
    ):
        read_landmarks(tmp_path)


def test_a_damaged_file_of_a_folder_is_named(tmp_path: Path) -> None:
    written(tmp_path, {"people": people()}, "a.json")
    written(tmp_path, '{"people": [', "b.json")
    with pytest.raises(ValueError, match=r"b\.json is not complete JSON"):
        read_landmarks(tmp_path)


def test_a_folder_without_hands_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"none of its 0 files .* has hands"):
        read_landmarks(tmp_path)
    written(tmp_path, {"people": []}, "a.json")
    with pytest.raises(ValueError, match=r"none of its 1 files .* has hands"):
        read_landmarks(tmp_path)


def test_shares_in_a_folder_are_multiplied_by_the_size_of_each_image(tmp_path: Path) -> None:
    for name, size in (("a", (100, 50)), ("b", (200, 400))):
        Image.new("L", size).save(tmp_path / f"{name}.png")
        content = {**mediapipe(0), "image": f"{name}.png"}
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    landmarks = read_landmarks(tmp_path)
    shares = POINTS / SIZE
    expected = np.concatenate([shares * (100, 50), shares * (200, 400)])
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), expected)


@pytest.mark.parametrize("apart", [True, False])
def test_labels_of_yolo_have_the_size_of_the_image_of_their_name(
    tmp_path: Path, apart: bool
) -> None:
    labels = tmp_path / "labels" / "train"
    images = tmp_path / "images" / "train" if apart else labels
    images.mkdir(parents=True)
    labels.mkdir(parents=True, exist_ok=True)
    Image.new("L", SIZE).save(images / "a.png")
    path = written(labels, yolo_labels(3), "a.txt")
    landmarks = read_landmarks(path)
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), POINTS)
    assert landmarks.images == (images / "a.png",) * 3
    # Visibility says nothing about the precision of a label.
    assert landmarks.confidence is None
    shutil.rmtree(tmp_path / "images", ignore_errors=True)
    (labels / "a.png").unlink(missing_ok=True)
    with pytest.raises(ValueError, match=r"image_size=\[width,height\]"):
        read_landmarks(path)


def test_a_label_of_yolo_with_visibility_0_is_missing(tmp_path: Path) -> None:
    words = yolo_labels(3).split("\n")[0].split()
    words[5 + 3 * 4 : 5 + 3 * 5] = ["0", "0", "0"]
    landmarks = read_landmarks(written(tmp_path, " ".join(words), "a.txt"), image_size=SIZE)
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 4]]


def test_a_line_of_yolo_with_another_number_of_keypoints_is_refused(tmp_path: Path) -> None:
    text = yolo_labels(3) + "\n0 0.5 0.5 0.1 0.1 0.3 0.4"
    with pytest.raises(
        ValueError, match=r"YOLO's labels, but line 4 is .*expected 5 numbers and 21"
    ):
        read_landmarks(written(tmp_path, text, "a.txt"), image_size=SIZE)


def test_bodies_of_ultralytics_without_hands_are_left_out(tmp_path: Path) -> None:
    body = {"keypoints": {"x": [1.0] * 17, "y": [2.0] * 17}}
    with pytest.raises(ValueError, match=r"no hands \(left out: bodies of 17 keypoints \(2\)\)"):
        read_landmarks(written(tmp_path, [body, body]))
    uneven = {"keypoints": {"x": [1.0] * 21, "y": [2.0] * 20}}
    with pytest.raises(
        ValueError, match=r"`keypoints` of result 0 is a list of 20.*expected 21 numbers"
    ):
        read_landmarks(written(tmp_path, [uneven]))
