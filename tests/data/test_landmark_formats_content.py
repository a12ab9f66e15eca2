"""JSON lines, encodings, arrays, and files of other kinds."""

import json
from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.landmark_writing import POINTS, assert_same_hands, with_scores, written


def test_json_lines_of_hands_frames_and_objects_are_read(tmp_path: Path) -> None:
    hands = POINTS.tolist()
    lines = [[json.dumps(hand) for hand in hands]]
    lines += [[json.dumps(frame) for frame in (hands[:2], hands[2:])]]
    lines += [[json.dumps({"landmarks": hand, "side": "right"}) for hand in hands]]
    for content in lines:
        assert_same_hands(read_landmarks(written(tmp_path, "\n".join(content) + "\n\n", "a.jsonl")))


def test_an_error_in_json_lines_says_that_they_were_read_as_such(tmp_path: Path) -> None:
    text = f'{{"landmarks": {POINTS[0].tolist()}}}\n{{"landmarks": [[1, 2]]}}'
    with pytest.raises(ValueError, match=r"hand 1 .* has 1 points.*read as JSON lines"):
        read_landmarks(written(tmp_path, text, "a.jsonl"))


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]
)
def test_text_may_be_in_any_unicode_encoding(tmp_path: Path, encoding: str) -> None:
    content = json.dumps([{"landmarks": POINTS[0].tolist(), "name": "Hände"}], ensure_ascii=False)
    path = tmp_path / "a.json"
    path.write_bytes(content.encode(encoding))
    landmarks = read_landmarks(path)
    assert_same_hands(landmarks, POINTS[:1])
    assert landmarks.names == ("Hände",)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89HDF\r\n\x1a\n", "HDF5.*DeepLabCut's, write it as CSV.*to_csv"),
        (b"PK\x03\x04", "zip archive. Unpack it"),
        (b"\x80\x04\x95", "a pickle. Write its landmarks as JSON"),
        (b"\xff\xd8\xff\xe0", "not text: it is a JPEG image"),
        (b"\x00\x00\x00\x18ftypisom", "not text: it is a video"),
        (b'{"a": "\xff"}', "is not text"),
        (b"\xff\xfe\x00", "is not text"),
    ],
)
def test_files_of_other_kinds_are_named_with_their_cure(
    tmp_path: Path, content: bytes, message: str
) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_landmarks(path)


def test_an_array_of_numpy_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for array in (POINTS, POINTS.astype(np.float32).astype(np.float64), np.array(with_scores())):
        np.save(path, array)
        assert_same_hands(read_landmarks(path), array[..., :2])
    np.save(path, POINTS[0])
    assert_same_hands(read_landmarks(path), POINTS[:1])


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 20, 2)), "holds 3 × 20 × 2 values of type float64; expected numbers"),
        (np.array([["a"]]), "of type <U1"),
        (np.array([None]), "not a whole .npy file"),
    ],
)
def test_other_arrays_are_refused(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ValueError, match=message):
        read_landmarks(tmp_path / "a.npy")
