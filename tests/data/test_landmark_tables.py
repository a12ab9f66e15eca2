"""Landmark files in CSV, and cameras beside landmarks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.landmark_writing import (
    CAMERA,
    POINTS,
    SCORES,
    assert_same_hands,
    table,
    with_scores,
    written,
)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("third", ["c", "confidence", "sigma"])
def test_a_table_with_one_row_per_hand(tmp_path: Path, delimiter: str, third: str) -> None:
    header = [f"{letter}{number}" for number in range(21) for letter in ("u", "v", third)]
    rows: list[list[Any]] = [["name", *header, "Side"]]
    for hand, values in enumerate(with_scores()):
        rows.append([f"hand {hand}", *np.array(values).ravel(), ("left", "", "right")[hand]])
    rows[1][1:3] = "", ""
    landmarks = read_landmarks(table(tmp_path, rows, delimiter))
    expected = POINTS.copy()
    expected[0, 0] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.names == ("hand 0", "hand 1", "hand 2")
    assert landmarks.left.tolist() == [True, False, False]
    told = landmarks.sigma if third == "sigma" else landmarks.confidence
    assert told is not None
    np.testing.assert_array_equal(told[1:].numpy(), SCORES[1:])
    assert told[0, 0].isnan()


@pytest.mark.parametrize("by_name", [True, False])
def test_a_table_with_one_row_per_landmark(tmp_path: Path, by_name: bool) -> None:
    rows: list[list[Any]] = [["hand", "landmark", "u", "v", "sigma", "side", "image"]]
    for hand in (1, 0):
        # Reversed and without the wrist: neither order nor completeness is required.
        for landmark in range(20, 0, -1):
            called = LANDMARKS[landmark].upper() if by_name else landmark
            rows.append([f"no {hand}", called, *POINTS[hand, landmark], 3.5, "left", f"{hand}.png"])
    landmarks = read_landmarks(table(tmp_path, rows))
    expected = POINTS[[1, 0]].copy()
    expected[:, 0] = np.nan
    assert_same_hands(landmarks, expected)
    assert landmarks.names == ("no 1", "no 0")
    assert landmarks.images == (tmp_path / "1.png", tmp_path / "0.png")
    assert landmarks.left.all()
    assert landmarks.sigma is not None
    assert (landmarks.sigma[:, 1:] == 3.5).all()


@pytest.mark.parametrize(
    "form", ["one.json", "each.json", "object.json", "text", "each.csv", "npy"]
)
def test_a_camera_can_be_given_in_any_of_these_forms(tmp_path: Path, form: str) -> None:
    flat = " ".join(str(number) for row in CAMERA for number in row)
    path = tmp_path / f"K.{form}"
    if form == "npy":
        np.save(path, np.array(CAMERA))
        path = path if path.is_file() else path.with_name(f"{path.name}.npy")
    else:
        content = {
            "one.json": json.dumps(CAMERA), "each.json": json.dumps([CAMERA] * 3),
            "object.json": json.dumps({"K": CAMERA}), "text": flat,
            "each.csv": "\n".join([flat.replace(" ", ",")] * 3),
        }[form]  # fmt: skip
        path.write_text(content)
    landmarks = read_landmarks(written(tmp_path, POINTS.tolist()), path)
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA] * 3


def test_a_camera_that_is_given_goes_before_the_files(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    other = [[500.0, 0, 100], [0, 500.0, 100], [0, 0, 1]]
    path = written(tmp_path, [{"landmarks": POINTS[0].tolist(), "K": other}])
    landmarks = read_landmarks(path, written(tmp_path, CAMERA, "K.json"))
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [CAMERA]
    assert "has camera matrices too" in caplog.text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([CAMERA] * 2, "holds 2 camera matrices for 3 hands; expected one for all"),
        (np.transpose(CAMERA).tolist(), r"not \[\[fx, skew, cx\].*column by column"),
        ([[0.8, 0, 0.5], [0, 0.8, 0.5], [0, 0, 1]], "focal lengths of a pixel or less"),
        ([[-900, 0, 640], [0, 900, 480], [0, 0, 1]], "focal lengths of a pixel or less"),
        ([[float("nan"), 0, 640], [0, 900, 480], [0, 0, 1]], "not finite"),
        ([[900, 640], [900, 480]], "holds 2 × 2 numbers, expected camera matrices of 3 × 3"),
        ([[900, 0], [0]], "must be 3 × 3 numbers"),
        ({"camera": CAMERA}, "an object with the keys .*camera.*expected one with `K`"),
        ("[[900, 0", "not complete JSON"),
        ("900 900 640 480", "holds 4 numbers, expected nine per camera matrix"),
        ("fx fy", "not a text of numbers"),
    ],
)
def test_what_is_no_camera_is_refused(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    path = written(tmp_path, POINTS.tolist())
    with pytest.raises(ValueError, match=message):
        read_landmarks(path, written(tmp_path, content, "K"))


def test_a_camera_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No camera matrices at .*K\.json"):
        read_landmarks(written(tmp_path, POINTS.tolist()), tmp_path / "K.json")


def test_the_tables_of_a_fit_are_read_or_refused_with_the_cure(tmp_path: Path) -> None:
    """`landmarks.csv` has projections in pixels; `hands.csv` has joint angles and no landmarks."""
    titles = [
        "hand",
        "image",
        "side",
        "landmark",
        "observed_u_px",
        "observed_v_px",
        "u_px",
        "v_px",
        "x_m",
    ]
    rows: list[list[Any]] = [titles]
    rows += [
        [hand, "", "left", name, "", "", *POINTS[hand, landmark], 0.01]
        for hand in range(2)
        for landmark, name in enumerate(LANDMARKS)
    ]
    landmarks = read_landmarks(table(tmp_path, rows))
    assert_same_hands(landmarks, POINTS[:2])
    assert landmarks.left.all()
    with pytest.raises(ValueError, match=r"give hands\.json or landmarks\.csv"):
        read_landmarks(
            table(tmp_path, [["hand", "residual_px", "index_MCP_bend_degrees"], [0, 1, 2]])
        )
