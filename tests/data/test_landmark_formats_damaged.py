"""Damaged files of every format end in a ValueError or are read, never in another error."""

import copy
import json
import warnings
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.annotation_files import SIZE
from tests.support.landmark_writing import written
from tests.support.tool_files import FILES, JSON_FILES

ODD: Final[tuple[Any, ...]] = (
    None, True, -1, 0, 1e308, 10**400, float("nan"), float("inf"), "", "a", "left", "7", [], {}, [[]], [None],
    [[1, 2]] * 21, [1] * 63, {"x": 1}, "\ud800", "\0",
)  # fmt: skip
"""Values that may stand in the place of others."""


def places(content: object, depth: int = 6) -> list[tuple[Any, Any]]:
    """Containers and keys of all values; of a long list, those of the first and the last."""
    if depth == 0 or not isinstance(content, dict | list):
        return []
    keys = (
        list(content)
        if isinstance(content, dict)
        else sorted({0, len(content) - 1} & set(range(len(content))))
    )
    found = [(content, key) for key in keys]
    for key in keys:
        found += places(content[key], depth - 1)
    return found


def read_or_refuse(path: Path) -> None:
    refusal = f"{path}: no refusal"
    try:
        assert len(read_landmarks(path, image_size=SIZE))
    except ValueError as error:
        refusal = str(error)
    assert str(path) in refusal
    assert len(refusal) < 2000


@pytest.mark.parametrize("form", JSON_FILES)
@given(data=st.data())
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_changed_value_is_refused_or_read(tmp_path: Path, form: str, data: st.DataObject) -> None:
    content = json.loads(JSON_FILES[form])
    for _ in range(data.draw(st.integers(1, 3))):
        possible = places(content)
        if not possible:
            break
        container, key = data.draw(st.sampled_from(possible))
        change = data.draw(st.sampled_from(["set", "delete", "repeat"]))
        if change == "delete":
            del container[key]
        elif change == "repeat" and isinstance(container, list):
            container.append(container[key])
        else:
            container[key] = copy.deepcopy(data.draw(st.sampled_from(ODD)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_or_refuse(written(tmp_path, content))


@pytest.mark.parametrize("form", FILES)
@given(data=st.data())
@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_file_with_changed_bytes_is_refused_or_read(
    tmp_path: Path, form: str, data: st.DataObject
) -> None:
    whole = FILES[form].content
    content = bytearray(whole if isinstance(whole, bytes) else whole.encode())
    start = data.draw(st.integers(0, len(content) - 1) | st.integers(0, 400))
    length = data.draw(st.integers(1, 40))
    content[start : start + length] = data.draw(st.binary(max_size=8))
    path = tmp_path / FILES[form].name
    path.write_bytes(content)
    read_or_refuse(path)


@pytest.mark.parametrize("form", FILES)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_refused_or_read(tmp_path: Path, form: str, share: float) -> None:
    whole = FILES[form].content
    content = whole if isinstance(whole, bytes) else whole.encode()
    path = tmp_path / FILES[form].name
    path.write_bytes(content[: int(share * len(content))])
    read_or_refuse(path)


@pytest.mark.parametrize(
    "opening", ["[", '{"a":', '{"people":[', '[{"keypoints":', '{"landmarks":[']
)
@pytest.mark.parametrize("depth", [60, 300, 900, 5000, 200_000])
def test_deep_nesting_is_refused(tmp_path: Path, opening: str, depth: int) -> None:
    closing = "".join(
        {"[": "]", "{": "}"}[letter] for letter in reversed(opening) if letter in "[{"
    )
    for text in (
        opening * depth + "1" + closing * depth,
        opening + "[" * depth + "]" * depth + closing,
    ):
        path = written(tmp_path, text)
        with pytest.raises(ValueError, match=r"landmarks\.json"):
            read_landmarks(path)


@pytest.mark.parametrize(
    "text",
    [
        "", " ", "\ufeff", "null", "7", '"a"', "[", "[]", "[[]]", "[[[]]]", "[[[[]]]]", "[[null]]",
        "[[[[[]]]]]", "{}", '{"people": {}}', '{"shapes": 3}', '{"annotations": [{}]}', '{"hands": []}',
        "[1]", '[{"landmarks": 3}]', '{"instance_info": []}', '{"predictions": [[]]}',
        "[[], {}]",
        '{"hands": {}}', '[{"people": []}]', '[{"annotations": [{"result": []}]}]', "\0\0", "<",
        "<a/>", ",,,\n1,2,3",
        "a,b\n1", 'scorer\n"', "hand,landmark,u,v\n,,,", '"', "[1]\n[2]", '{"a": 1}\n{"b": 2}',
        '{"handedness": [[]], "landmarks": [[]]}', '{"annotations": [{"keypoints": [[1, 2, 3, 4]]}]}',
        "[" + "[1,2]," * 20 + '"a"]', '{"categories": 3, "annotations": []}', "[[[1,2],[3,4]],[[5,6]]]",
        '{"annotations": [], "images": [{"id": []}]}', '{"wrist": 3}',
    ],
)  # fmt: skip
def test_small_files_of_nothing_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ValueError, match=r"landmarks\.json"):
        read_landmarks(written(tmp_path, text))


def test_large_counts_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    content = FILES["pose 0.2"].content
    assert isinstance(content, bytes)
    # Frames and people follow the header, in front of 2 × 43 points.
    start = len(content) - 2 * 43 * 4 * 4 - 6
    path = tmp_path / "a.pose"
    path.write_bytes(content[:start] + b"\xff" * 6 + content[start + 6 :])
    with pytest.raises(ValueError, match="cut off"):
        read_landmarks(path)


def test_the_messages_of_wrong_values_name_the_tool_the_place_and_the_cure(tmp_path: Path) -> None:
    content = json.loads(str(FILES["mmpose image"].content))
    content[1]["keypoints"][3] = ["a", 2]
    with pytest.raises(
        ValueError,
        match=r"mmpose's predictions, but `keypoints` of instance 1 is a list of 21.*Export",
    ):
        read_landmarks(written(tmp_path, content))
