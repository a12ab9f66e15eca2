"""Refusals of files of hands that are not of the format, and of numbers that JSON cannot hold."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.fitting.hands_file import (
    hand_entries,
    read_hands,
    writing_hands,
)
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.model import HandModel
from tests.support.fitted_hands import fitted


def test_a_number_that_is_not_finite_is_not_written(hand: HandModel, tmp_path: Path) -> None:
    good = to_records(fitted(hand))
    shape = good.shape.copy()
    shape[1, 3] = np.inf
    with (
        pytest.raises(ValueError, match="not JSON compliant"),
        writing_hands(tmp_path / "hands.json") as write_part,
    ):
        write_part(dataclasses.replace(good, shape=shape))
    assert not (tmp_path / "hands.json").exists()
    assert len(json.loads((tmp_path / "hands.json.part").read_text())) == 1


Entry = dict[str, Any]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda a: a.pop("shape"), "hand 1: the hand is an object without shape; expected the keys image, "),
        (lambda a: a.update(extra=1), "hand 1: the hand is an object with the unknown key extra; expected"),
        (lambda a: a.update(name=3), "hand 1: name is 3; expected a string"),
        (lambda a: a.update(side="both"), "hand 1: side is both; expected 'left' or 'right'"),
        (lambda a: a.update(verdict=1), "verdict is 1; expected 'plausible' or 'doubtful' or 'not f"),
        (lambda a: a.update(verdict="not fitted"), "landmarks_3d is .*; expected null, because the"),
        (lambda a: a.update(reasons="x"), "reasons is x; expected a list of sentences"),
        (lambda a: a.update(image=3), "image is 3; expected a file name or null"),
        (lambda a: a["joint_angles_degrees"].pop("thumb IP"), "joint_angles_degrees' is .* without thumb"),
        (lambda a: a["joint_angles_degrees"]["thumb IP"].pop("bend"), "thumb IP is an object without bend"),
        (lambda a: a.update(shape=None), r"shape is null; expected finite numbers of shape \(10,\)"),
        (lambda a: a["shape"].pop(), r"shape is \[.*; expected finite numbers of shape \(10,\)"),
        (lambda a: a["landmarks_3d"][4].pop(), r"landmarks_3d is \[.*\.\.\.; expected finite numbers"),
        (lambda a: a["landmarks_2d"][4].insert(0, None), r"landmarks_2d is .*of shape \(21, 2\)"),
        (lambda a: a["landmarks_2d"].__setitem__(4, [None, 1.0]), r"expected finite .* \(21, 2\)"),
        (lambda a: a["landmarks_2d"].__setitem__(4, ["1", "2"]), r"expected finite .* \(21, 2\)"),
        (lambda a: a.update(residual=True), "residual is true; expected a finite number"),
        (lambda a: a.update(camera=None), "'camera' is null; expected an object with the keys intrinsics, "),
        (lambda a: a["camera"].pop("source"), "'camera' is an object without source; expected the keys int"),
        (lambda a: a["camera"].update(source="x"), "camera source is x; expected 'given' or 'EXIF'"),
        (lambda a: a["camera"].update(image_size=[3]), r"image_size is \[3\]; .* \(2,\)"),
        (lambda a: a.update(root_rotation=[1, 0, 0]), r"root_rotation is \[1, 0, 0\]; .* \(3, 3\)"),
        (lambda a: a.update(loss=[1.0]), r"loss is \[1.0\]; expected an object with a number per term"),
        (lambda a: a["loss"].update(data="x"), "data is x; expected a finite number"),
    ],
)  # fmt: skip
def test_a_hand_that_is_not_of_the_format_is_refused_by_name(
    hand: HandModel, tmp_path: Path, spoil: Callable[[Entry], object], said: str
) -> None:
    entries = list(hand_entries(to_records(fitted(hand))))
    spoil(entries[1])
    path = tmp_path / "hands.json"
    path.write_text(json.dumps(entries), encoding="utf-8")
    with pytest.raises(ValueError, match=f"hands.json, .*{said}"):
        read_hands(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not JSON .* expected a list of hands"),
        ("[{}", "is not JSON"),
        ("[NaN]", "found NaN, which is not a JSON number"),
        ("{}", "holds a JSON dict; expected a list with one object per hand"),
        ("[3]", "hand 0: the hand is 3; expected an object with the keys image, name"),
    ],
)
def test_a_file_that_is_no_list_of_hands_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "hands.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_hands(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No file of hands at .*gone\.json"):
        read_hands(tmp_path / "gone.json")
