"""The binary files of pose-format."""

import struct
from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.annotation_files import SIZE
from tests.support.landmark_writing import POINTS
from tests.support.tool_files import pose_file


def in_folder(folder: Path, content: bytes) -> Path:
    path = folder / "a.pose"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("version", [0.1, 0.2])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_hands_are_called_by_their_frame_and_side(
    tmp_path: Path, version: float, dimensions: int
) -> None:
    landmarks = read_landmarks(in_folder(tmp_path, pose_file(version, dimensions)))
    assert landmarks.names == ("frame 0 left", "frame 0 right", "frame 1 right")
    np.testing.assert_allclose(landmarks.landmarks_2d.numpy(), POINTS, rtol=1e-6)
    assert landmarks.image_sizes is not None
    assert landmarks.image_sizes.tolist() == [list(SIZE)] * 3


def test_frames_of_version_0_1_are_counted_by_the_size_of_the_file(tmp_path: Path) -> None:
    """The header's 16 bits count to 65,535, and longer files have the remainder there."""
    content = bytearray(pose_file(0.1))
    place = len(content) - 2 * 43 * 4 * 4 - 4
    assert struct.unpack_from("<HH", content, place) == (2, 1)
    struct.pack_into("<H", content, place, 40_000)
    assert len(read_landmarks(in_folder(tmp_path, bytes(content)))) == 3


def test_scores_other_than_one_are_confidences(tmp_path: Path) -> None:
    content = bytearray(pose_file())
    struct.pack_into("<f", content, len(content) - 4, 0.25)
    landmarks = read_landmarks(in_folder(tmp_path, bytes(content)))
    assert landmarks.confidence is not None
    assert landmarks.confidence[2, 20] == 0.25
    assert landmarks.confidence[2, 19] == 1
    assert landmarks.confidence[:2].isnan().all()


@pytest.mark.parametrize("length", [4, 10, 15, 200, 1000, -1])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, length: int) -> None:
    with pytest.raises(ValueError, match=r"cut off|none of its components"):
        read_landmarks(in_folder(tmp_path, pose_file()[:length]))


def test_a_file_without_hands_names_its_components(tmp_path: Path) -> None:
    content = pose_file().replace(b"_HAND_", b"_FOOT_")
    with pytest.raises(
        ValueError, match=r"none of its components is a hand: \['POSE_LANDMARKS', 'LEFT_FOOT"
    ):
        read_landmarks(in_folder(tmp_path, content))


def test_another_version_is_not_text(tmp_path: Path) -> None:
    content = struct.pack("<f", 0.7) + pose_file()[4:]
    with pytest.raises(ValueError, match="is not text"):
        read_landmarks(in_folder(tmp_path, content))
