"""Files of detectors and annotation tools: each is recognised by its content and gives the same hands."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from tests.support.annotation_files import SIZE, flat
from tests.support.landmark_writing import POINTS, SCORES, assert_same_hands, written
from tests.support.tool_files import FILES, ToolFile, mediapipe, mmpose_instances, people


def in_folder(folder: Path, file: ToolFile) -> Path:
    path = folder / file.name
    path.write_bytes(file.content if isinstance(file.content, bytes) else file.content.encode())
    return path


def assert_hands(landmarks: ImageLandmarks, points: np.ndarray = POINTS) -> None:
    """Equal up to the rounding of shares, percents and single precision."""
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), points, rtol=1e-6)


@pytest.mark.parametrize("form", FILES)
def test_every_tools_file_gives_the_same_hands_and_the_log_names_the_tool(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, form: str
) -> None:
    file = FILES[form]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(
            in_folder(tmp_path, file), image_size=SIZE if file.in_shares else None
        )
    assert_hands(landmarks)
    if file.has_sides:
        assert landmarks.left.tolist() == [True, False, False]
        assert "1 left and 2 right hands are read" in caplog.text
    else:
        assert "3 right hands are read" in caplog.text
    assert (landmarks.confidence is not None) == file.has_scores
    if landmarks.confidence is not None:
        np.testing.assert_allclose(landmarks.confidence.numpy(), SCORES)
    told = [record for record in caplog.records if file.tool in record.getMessage()]
    assert len(told) == 1


@pytest.mark.parametrize("form", [name for name, file in FILES.items() if file.in_shares])
def test_shares_of_an_image_of_unknown_size_are_refused_with_the_cure(
    tmp_path: Path, form: str
) -> None:
    with pytest.raises(ValueError, match=r"3 of 3 hands .* shares .*image_size=\[width,height\]"):
        read_landmarks(in_folder(tmp_path, FILES[form]))


def test_shares_are_multiplied_by_the_size_that_the_file_states(tmp_path: Path) -> None:
    content = {**mediapipe(0), "width": SIZE[0], "height": SIZE[1]}
    # A given size is for images whose size is not known otherwise.
    assert_hands(read_landmarks(written(tmp_path, content), image_size=(3, 4)))


def test_shares_are_multiplied_by_the_size_of_the_image_beside_the_file(tmp_path: Path) -> None:
    Image.new("L", SIZE).save(tmp_path / "a.png")
    content = {**mediapipe(0), "image": "a.png"}
    landmarks = read_landmarks(written(tmp_path, content))
    assert_hands(landmarks)
    assert landmarks.images == (tmp_path / "a.png",) * 3


def test_plain_lists_in_shares_are_pixels_once_the_size_is_given(tmp_path: Path) -> None:
    """640 × 480: (0.5, 0.25) is the pixel (320, 120)."""
    hand = [[0.5, 0.25], *([[0.1, 1.2]] * 20)]
    landmarks = read_landmarks(written(tmp_path, [hand]), image_size=(640, 480))
    assert landmarks.landmarks_2d[0, 0].tolist() == [320, 120]
    assert landmarks.landmarks_2d[0, 1].tolist() == [64, 576]


@pytest.mark.parametrize(
    ("index_of_right", "spelling", "swapped"),
    [
        (0, "categoryName", False),
        (1, "categoryName", True),
        (1, "label", True),
        (0, "label", False),
    ],
)
def test_the_index_of_a_category_tells_which_side_mediapipe_means(
    tmp_path: Path, index_of_right: int, spelling: str, swapped: bool
) -> None:
    """Since version 0.10.5 the index 0 is the right hand's; before, sides were those of the mirror image."""
    path = written(tmp_path, mediapipe(index_of_right, spelling))
    left = read_landmarks(path, image_size=SIZE).left.tolist()
    assert left == [swapped != (side == "left") for side in ("left", "right", "right")]


def test_mediapipe_solutions_name_the_side_of_the_mirrored_image(tmp_path: Path) -> None:
    tasks = mediapipe(None)
    content = {
        "multi_hand_landmarks": [{"landmark": hand} for hand in tasks["landmarks"]],
        "multi_handedness": [
            {"classification": [{"label": entry[0]["categoryName"], "score": 0.9}]}
            for entry in tasks["handedness"]
        ],
    }
    landmarks = read_landmarks(written(tmp_path, content), image_size=SIZE)
    assert_hands(landmarks)
    assert landmarks.left.tolist() == [False, True, True]


def test_mediapipes_world_landmarks_alone_are_refused_as_3d(tmp_path: Path) -> None:
    content = {"worldLandmarks": mediapipe(0)["worldLandmarks"], "handedness": []}
    with pytest.raises(ValueError, match=r"world landmarks, which are 3D points in metres"):
        read_landmarks(written(tmp_path, content), image_size=SIZE)


def test_points_in_metres_about_a_point_of_the_hand_are_not_multiplied(tmp_path: Path) -> None:
    around = np.random.default_rng(2).uniform(-0.1, 0.1, (2, 21, 2))
    with pytest.raises(ValueError, match="relative to a point of the hand"):
        read_landmarks(written(tmp_path, around.tolist()), image_size=SIZE)


def test_mediapipes_frames_without_hands_are_passed_over(tmp_path: Path) -> None:
    empty: dict[str, Any] = {"handedness": [], "landmarks": []}
    landmarks = read_landmarks(written(tmp_path, [empty, mediapipe(0), empty]), image_size=SIZE)
    assert landmarks.names == ("frame 1, hand 0", "frame 1, hand 1", "frame 1, hand 2")


def test_a_hand_that_openpose_did_not_find_is_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    one = people()[1]
    path = written(tmp_path, {"people": [one, {**one, "hand_left_keypoints_2d": []}]})
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(path)
    assert landmarks.names == ("person 0 right", "person 1 right")
    assert (
        "OpenPose's people; 2 right hands are read; left out: hands that were not found (2)"
        in caplog.text
    )


def test_keypoints_of_openpose_without_score_are_missing(tmp_path: Path) -> None:
    numbers = flat(0)
    numbers[5 * 3 : 6 * 3] = [0, 0, 0]
    landmarks = read_landmarks(written(tmp_path, {"people": [{"hand_left_keypoints": numbers}]}))
    assert (~landmarks.labelled).nonzero().tolist() == [[0, 5]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"people": [{"pose_keypoints_2d": [1.0] * 75}] * 2}, "none of 2 has hands. Run OpenPose with"),
        ({"people": []}, "OpenPose's people and holds no hands"),
        ({"people": [{"hand_left_keypoints_2d": [0] * 63}]}, r"no hands \(left out: hands that were not"),
        ({"people": [{"hand_left_keypoints_2d": [1] * 60}]}, "a list of 60 entries; expected 63 numbers"),
        ({"people": [7]}, "`people`, entry 0 is 7; expected an object"),
    ],
)  # fmt: skip
def test_openpose_files_without_hands_have_their_cure(
    tmp_path: Path, content: object, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(written(tmp_path, content))


def test_scores_of_mmpose_above_one_are_read_as_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """AlphaPose's reach 6, RTMPose's 1.2."""
    instances = mmpose_instances()
    instances[0]["keypoint_scores"][:3] = [1.001, 6.0, -0.1]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, instances))
    assert landmarks.confidence is not None
    assert landmarks.confidence[0, :2].tolist() == [1.0, 1.0]
    assert not landmarks.labelled[0, 2]
    assert landmarks.confidence[1].tolist() == SCORES[1].tolist()
    assert (
        "3 of 63 scores are above 1 or below 0 and are read as 1 and 0; the highest is 6"
        in caplog.text
    )
    assert not [record for record in caplog.records if record.levelno > logging.INFO]


def test_scores_that_are_above_one_for_the_most_part_are_warned_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    instances = mmpose_instances()
    for instance in instances:
        instance["keypoint_scores"] = [3.0] * 21
    landmarks = read_landmarks(written(tmp_path, instances))
    assert landmarks.confidence is not None
    assert (landmarks.confidence == 1).all()
    assert "63 of 63 scores are above 1" in caplog.text


def test_bodies_of_mmpose_without_hands_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    body = {"keypoints": [[1.0, 2.0]] * 17, "keypoint_scores": [0.5] * 17}
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, [*mmpose_instances(), body, body]))
    assert_same_hands(landmarks)
    assert "left out: bodies of 17 keypoints (2)" in caplog.text
    with pytest.raises(ValueError, match=r"no hands \(left out: bodies of 17 keypoints \(1\)\)"):
        read_landmarks(written(tmp_path, [body]))
