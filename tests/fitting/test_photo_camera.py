import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.photo_camera import (
    CameraChoice,
    assumed_focal,
    given_cameras,
    parse_camera,
    with_given_camera,
)

NO_HANDS = np.zeros(0)


def test_a_field_of_view_is_that_of_the_longer_side() -> None:
    choice = parse_camera("fov=90", 1)
    for size in ((400, 300), (300, 400)):
        camera = choice.of_photo(size, 777.0, NO_HANDS)
        # tan 45° = 1: the focal length is half of the longer side.
        expected = np.array([[200, 0, size[0] / 2], [0, 200, size[1] / 2], [0, 0, 1]])
        np.testing.assert_allclose(camera.matrix, expected)
        assert camera.source == "field of view"
    sixty = parse_camera("fov=60", 1).of_photo((1000, 10), None, NO_HANDS)
    assert sixty.matrix[0, 0] == pytest.approx(500 * math.sqrt(3))


def test_exif_is_used_where_it_is_there() -> None:
    for name in ("auto", "exif"):
        camera = parse_camera(name, 1).of_photo((400, 300), 321.0, NO_HANDS)
        assert (camera.source, camera.matrix[0, 0], camera.matrix[1, 1]) == ("EXIF", 321, 321)
        assert camera.matrix[:2, 2].tolist() == [200, 150]
    assert parse_camera("auto", 1).of_photo((400, 300), None, NO_HANDS).source == "assumed"
    assert parse_camera("assumed", 1).of_photo((400, 300), 321.0, NO_HANDS).source == "assumed"
    with pytest.raises(ValueError, match=r"EXIF has no focal length .*camera=fov=<degrees>"):
        parse_camera("exif", 1).of_photo((400, 300), None, NO_HANDS)


def test_the_assumed_focal_length_grows_with_a_hand_that_fills_the_photograph() -> None:
    assert assumed_focal((400, 300), np.array([100.0])) == 480
    assert assumed_focal((400, 300), NO_HANDS) == 480
    # 500 px on a crop of 224 px, 1.5 times as wide as the hand: 200 · 1.5 · 500 / 224.
    assert assumed_focal((200, 200), np.array([50.0, 200.0])) == pytest.approx(669.64, abs=0.01)


def hands_at(count: int, size: tuple[int, int]) -> ImageLandmarks:
    points = torch.rand(count, 21, 2, dtype=torch.float64) * torch.tensor(size)
    return ImageLandmarks(
        points, torch.ones(count, 21, dtype=torch.bool), torch.zeros(count, dtype=torch.bool),
        ("a",) * count, image_sizes=torch.tensor([size] * count, dtype=torch.float64),
    )  # fmt: skip


def test_matrices_of_a_file_are_for_all_photographs_or_one_each(tmp_path: Path) -> None:
    one, two = ([[f, 0, 32], [0, f + 1, 24], [0, 0, 1]] for f in (50.0, 60.0))
    file = tmp_path / "K (1).json"
    file.write_text(json.dumps(one))
    hands = hands_at(2, (64, 48))
    given = with_given_camera(hands, parse_camera(str(file), 3), 2)
    assert given.intrinsics is not None
    assert given.intrinsics.tolist() == [one, one]
    assert torch.equal(given.landmarks_2d, hands.landmarks_2d)
    file.write_text(json.dumps([one, two]))
    given = with_given_camera(hands, parse_camera(str(file), 2), 1)
    assert given.intrinsics is not None
    assert given.intrinsics.tolist() == [two, two]
    with pytest.raises(ValueError, match="2 cameras for 3 photographs"):
        parse_camera(str(file), 3)
    arrays = with_given_camera(hands, given_cameras(np.array([two])), 7)
    assert arrays.intrinsics is not None
    assert arrays.intrinsics.tolist() == [two, two]
    with pytest.raises(ValueError, match="no file of cameras in camera=auto"):
        with_given_camera(hands, CameraChoice(), 0)


def test_a_camera_with_lens_distortion_moves_the_landmarks(tmp_path: Path) -> None:
    file = tmp_path / "K.json"
    matrix = [[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]
    file.write_text(json.dumps({"K": matrix, "dist": [0.1, 0, 0, 0, 0], "image_size": [64, 48]}))
    hands = hands_at(1, (64, 48))
    given = with_given_camera(hands, parse_camera(str(file), 1), 0)
    expected = cv2.undistortPoints(
        hands.landmarks_2d[0].numpy(), np.array(matrix), np.array([0.1, 0, 0, 0, 0]), P=np.array(matrix)
    )[:, 0]  # fmt: skip
    np.testing.assert_allclose(given.landmarks_2d[0], expected, atol=1e-3)


@pytest.mark.parametrize("text", ["fov=0", "fov=x", "fov=179", "fov=nan", "fov=inf", "fov=-60"])
def test_a_field_of_view_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no field of view; expected the angle"):
        parse_camera(text, 1)


def test_a_camera_that_is_neither_choice_nor_file_is_refused() -> None:
    with pytest.raises(FileNotFoundError, match="camera=EXIF is neither auto, exif, assumed, fov="):
        parse_camera("EXIF", 1)
    assert CameraChoice().name == "auto"
