"""Hands of a clip in the file of hands: the key that hands of photographs lack, and its refusals."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hand_recon.fitting.hands_file import read_hands, writing_hands
from hand_recon.fitting.origin import Moment, Origin
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.model import HandModel
from tests.support.fitted_hands import fitted

SCHEMA = json.loads((files("hand_recon.fitting") / "hands.schema.json").read_text(encoding="utf-8"))

MOMENT = Moment(hand=2, frame=7, time=0.2331667, seen=False)


def written(hand: HandModel, path: Path) -> list[dict[str, Any]]:
    """A file of three hands, of which the second is of a clip, as plain JSON."""
    part = fitted(hand)
    origins = [Origin(), Origin(moment=MOMENT), Origin()]
    with writing_hands(path) as write:
        write(to_records(replace(part, origins=tuple(origins))))
    content: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return content


def test_hands_of_a_clip_alone_have_the_key(hand: HandModel, tmp_path: Path) -> None:
    content = written(hand, tmp_path / "hands.json")
    assert ["clip" in entry for entry in content] == [False, True, False]
    assert content[1]["clip"] == {"hand": 2, "frame": 7, "time": 0.233167, "seen": False}
    jsonschema.validate(content, SCHEMA)
    assert read_hands(tmp_path / "hands.json").moments == (
        None, replace(MOMENT, time=0.233167), None,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hand": 0}, "hand or frame is \\[0, 7\\]; expected whole numbers from 1 and 0"),
        ({"hand": 1.5}, "whole numbers"),
        ({"frame": -1}, "whole numbers"),
        ({"time": "0.2"}, "time is 0.2; expected a finite number"),
        ({"seen": 1}, "seen is 1; expected true or false"),
        ({"place": 3}, "with the unknown key place"),
    ],
)
def test_wrong_values_are_refused(
    hand: HandModel, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "hands.json"
    content = written(hand, path)
    content[1]["clip"] |= change
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_hands(path)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, SCHEMA)


def test_a_missing_value_is_refused(hand: HandModel, tmp_path: Path) -> None:
    path = tmp_path / "hands.json"
    content = written(hand, path)
    del content[1]["clip"]["seen"]
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match="without seen"):
        read_hands(path)
