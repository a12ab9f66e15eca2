"""Tables: DeepLabCut's, and those whose rows or columns are named after landmarks."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.annotation_files import (
    deeplabcut,
)
from tests.support.landmark_writing import POINTS, assert_same_hands, table, written


def test_deeplabcut_of_one_animal_has_a_hand_per_frame(tmp_path: Path) -> None:
    rows = [row.split(",") for row in deeplabcut().split("\n")]
    keep = [0, *range(64, 127)]
    rows = [[row[column] for column in keep] for row in rows if row[0] != "individuals"]
    lost = ["8", *[""] * 63]
    landmarks = read_landmarks(table(tmp_path, [*rows, lost, ["9", *rows[-1][1:]]]))
    assert_same_hands(landmarks, POINTS[[1, 1]])
    assert landmarks.names == ("frame 7", "frame 9")


def test_labels_of_deeplabcut_are_called_by_their_image(tmp_path: Path) -> None:
    rows = [row.split(",") for row in deeplabcut().split("\n")]
    index = [["", ""]] * 4 + [["video", "img007.png"]]
    rows = [[row[0], *extra, *row[1:]] for row, extra in zip(rows, index, strict=True)]
    rows[-1][0] = "labeled-data"
    landmarks = read_landmarks(table(tmp_path, rows))
    assert landmarks.images == (tmp_path / "labeled-data/video/img007.png",) * 3
    assert_same_hands(landmarks)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scorer,a,a\nbodyparts,wrist,wrist\n1,2,3", "first rows begin with .*save_as_csv"),
        ("scorer,a,a\nbodyparts,tail,tail\ncoords,x,y\n1,2,3", r"none of its body parts.*\['tail'\]"),
        ("scorer,a,a\nbodyparts,wrist,wrist\ncoords,x,y\n1,2", "expected 3 cells"),
        ("scorer,a,a\nbodyparts,wrist,wrist\ncoords,x,y\n1,2,b", "'b'; expected a number"),
        ("scorer,a,a\nbodyparts,wrist,root\ncoords,x,x\n1,2,3", "two body parts are the same"),
        ("scorer,a,a\nbodyparts,wrist,wrist\ncoords,x,y", "holds no hands"),
    ],
)  # fmt: skip
def test_mistakes_in_deeplabcuts_table_have_their_message(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(written(tmp_path, text, "a.csv"))


def test_named_columns_of_two_sides_make_two_hands_of_a_row(tmp_path: Path) -> None:
    titles = [
        f"{side} {name} {axis}" for side in ("Left", "Right") for name in LANDMARKS for axis in "xy"
    ]
    rows = [["frame", *titles], [12, *POINTS[:2].ravel()], [13, *[""] * 42, *POINTS[2].ravel()]]
    landmarks = read_landmarks(table(tmp_path, rows))
    assert_same_hands(landmarks)
    assert landmarks.left.tolist() == [True, False, False]
    assert landmarks.names == ("12 left", "12 right", "13 right")


def test_named_columns_may_have_sigmas(tmp_path: Path) -> None:
    titles = [f"{name}.{axis}" for name in LANDMARKS for axis in ("x", "y", "sigma")]
    numbers = np.concatenate([POINTS[0], np.full((21, 1), 3.5)], axis=1).ravel()
    landmarks = read_landmarks(table(tmp_path, [titles, list(numbers), [""] * 63]))
    assert_same_hands(landmarks, POINTS[:1])
    assert landmarks.sigma is not None
    assert (landmarks.sigma == 3.5).all()
    with pytest.raises(ValueError, match="'far'; expected a number"):
        read_landmarks(table(tmp_path, [titles, ["far", *numbers[1:]]]))


@pytest.mark.parametrize("column", ["image", "frame"])
def test_hands_that_are_numbered_anew_in_each_image_are_hands_of_their_own(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, column: str
) -> None:
    rows: list[list[Any]] = [[column, "hand", "landmark", "x", "y"]]
    rows += [
        [f"{image}.png", hand, landmark, *(POINTS[2 * image + hand, landmark])]
        for image, hand in ((0, 0), (0, 1), (1, 0))
        for landmark in range(21)
    ]
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(table(tmp_path, rows))
    assert_same_hands(landmarks)
    assert landmarks.names == ("0.png 0", "0.png 1", "1.png 0")
    assert "numbered anew in each image; 3 right hands are read" in caplog.text
    with pytest.raises(ValueError, match=r"more than once.*add a column `image`"):
        read_landmarks(table(tmp_path, [row[1:] for row in rows]))


def test_landmarks_of_a_table_may_have_the_names_of_any_tool(tmp_path: Path) -> None:
    rows: list[list[Any]] = [["hand", "landmark", "u", "v"]]
    names = ["WRIST", "thumb1", "Thumb MCP", "thumbIP", "THUMB_TIP", "INDEX_FINGER_MCP"]
    rows += [[0, name, *POINTS[0, landmark]] for landmark, name in enumerate(names)]
    landmarks = read_landmarks(table(tmp_path, rows))
    expected = POINTS[:1].copy()
    expected[:, 6:] = np.nan
    assert_same_hands(landmarks, expected)


def test_sides_in_the_names_of_a_table_are_different_hands(tmp_path: Path) -> None:
    rows: list[list[Any]] = [["frame", "hand", "landmark", "x", "y"]]
    rows += [
        [0, 0, f"{side}_{name}", *POINTS[hand, landmark]]
        for hand, side in enumerate(("left", "right"))
        for landmark, name in enumerate(LANDMARKS)
    ]
    landmarks = read_landmarks(table(tmp_path, rows))
    assert_same_hands(landmarks, POINTS[:2])
    assert landmarks.left.tolist() == [True, False]
    assert landmarks.names == ("0 left", "0 right")


def test_hands_of_a_table_that_are_called_by_their_side_have_it(tmp_path: Path) -> None:
    rows: list[list[Any]] = [["hand", "landmark", "x", "y"]]
    rows += [
        [hand, landmark, *POINTS[number, landmark]]
        for number, hand in enumerate(("Left", "right hand", "3"))
        for landmark in range(21)
    ]
    assert read_landmarks(table(tmp_path, rows)).left.tolist() == [True, False, False]
    # The name of an image tells no side.
    of_image = [["image", *rows[0]], *(["left_camera.png", *row] for row in rows[1:])]
    assert read_landmarks(table(tmp_path, of_image)).left.tolist() == [True, False, False]
    anew = [*of_image, *(["left_other.png", *row] for row in rows[43:])]
    assert read_landmarks(table(tmp_path, anew)).left.tolist() == [True, False, False, False]
