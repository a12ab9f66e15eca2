"""Errors in landmark files are reported with their cause."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.landmark_writing import (
    CAMERA,
    POINTS,
    SCORES,
    table,
    with_scores,
    written,
)


def changed(hand: int, landmark: int, point: Any) -> list[Any]:  # noqa: ANN401
    hands: list[Any] = POINTS.tolist()
    hands[hand][landmark] = point
    return hands


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "columns .*expected one row per hand"),
        ("[]", "holds no hands"),
        ("[[[1, 2], [3", "not complete JSON .*cut off"),
        ('{"landmarks": []}\n{"landmarks": []}', "JSON lines"),
        ("{}", "object with the keys"),
        ([POINTS[0, :20].tolist()], r"hand 0 .* has 20 points, expected 21"),
        ([POINTS[0].tolist(), [[1, 2]] * 22], r"hand 1 .* has 22 points, expected 21"),
        ([POINTS[0].tolist(), 7], r"hand 1 .* has 7, expected 21"),
        (changed(2, 5, [1.0]), r"landmark 5 of hand 2 is \[1.0\], expected \[u, v\]"),
        (changed(2, 5, [1.0, 2.0, 3.0, 4.0]), r"landmark 5 of hand 2 is"),
        (changed(2, 5, ["left", 3.0]), "a coordinate is not a number"),
        (changed(1, 5, [float("inf"), 3.0]), "1 of 3 hands have infinite coordinates.*: 1"),
        (changed(1, 5, [None, 30.0]), "1 of 3 hands have landmarks with one coordinate only.*: 1"),
        ((POINTS / 2000).tolist(), "shares of the image's size, as MediaPipe gives them"),
        (with_scores(third_value=SCORES - 0.5), "a σ that is not positive.*MediaPipe's z"),
        (with_scores(third_value=np.full((3, 21), np.inf)), "a σ that is not positive and finite"),
        ([{"landmarks": POINTS[0].tolist(), "confidence": [1.5] * 21}], r"outside \[0, 1\]"),
        ([{"landmarks": POINTS[0].tolist(), "sigma": [1.0] * 20}], "`sigma` must be a list of 21"),
        ([{"landmarks": POINTS[0].tolist(), "side": "both"}], "hand 0 has the side 'both'"),
        ([{"points": POINTS[0].tolist()}], "entry 0 is not an object with `landmarks`"),
        ([{"landmarks": POINTS[0].tolist()}, POINTS[0].tolist()], "entry 1 is not an object"),
        (
            [{"landmarks": POINTS[0].tolist(), "K": CAMERA}, {"landmarks": POINTS[1].tolist()}],
            "1 of 2 hands have a camera matrix, hand 1 has none",
        ),
        ({"annotations": []}, "none of 0 annotations has a hand"),
        ({"annotations": [{"id": 4, "keypoints": [1] * 51}]}, "of annotation 4 has 51 numbers.*133 or 136"),
        ([{"keypoints": ["a"] * 63}], "a keypoint or a box is not a number"),
    ],
)  # fmt: skip
def test_every_mistake_has_its_message(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    path = written(tmp_path, content)
    with pytest.raises(ValueError, match=f"(?s){message}"):
        read_landmarks(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([["x", "y"], [1, 2]], "has the columns .*'x'.*expected one row per hand"),
        ([["u0", "v0"], [1, 2]], r"lacks the columns \['u1'"),
        ([["u0", "u0"], [1, 2]], "two columns of one name"),
        ([["hand", "landmark", "u", "v"], [0, 1, 2]], "line 2: 3 cells for 4 columns"),
        ([["hand", "landmark", "u", "v"], [0, 21, 2, 3]], "unknown landmark '21'"),
        ([["hand", "landmark", "u", "v"], [0, 1, 20, 30], [0, "thumb CMC", 2, 3]], "more than once"),
        ([["hand", "landmark", "u", "v"], [0, 1, "left", 3]], "a cell is not a number"),
        ([["hand", "landmark", "u", "v"]], "holds no hands"),
    ],
)  # fmt: skip
def test_every_mistake_in_a_table_has_its_message(
    tmp_path: Path, rows: list[list[Any]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(table(tmp_path, rows))


def test_a_file_that_is_not_there_or_no_text_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No landmarks at .*nothing\.json"):
        read_landmarks(tmp_path / "nothing.json")
    (tmp_path / "a.json").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ValueError, match=r"a\.json is not text"):
        read_landmarks(tmp_path / "a.json")


def test_hands_with_three_landmarks_are_kept_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    three: list[Any] = [None] * 18 + POINTS[0, :3].tolist()
    four: list[Any] = [None] * 17 + POINTS[0, :4].tolist()
    landmarks = read_landmarks(written(tmp_path, [three, four]))
    assert landmarks.usable.tolist() == [False, True]
    assert "1 of 2 hands have fewer than 4 labelled landmarks" in caplog.text
    assert torch.equal(landmarks.labelled.sum(dim=1), torch.tensor([3, 4]))
