"""Round trip, contents and refusals of the file of hands."""

import dataclasses
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.fitting.hands_file import (
    DECIMALS,
    SHAPES,
    HandRecords,
    hand_entries,
    read_hands,
    write_names,
    writing_hands,
)
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from tests.support.fitted_hands import fitted


@st.composite
def fields_of_hands(draw: st.DrawFn) -> dict[str, Any]:
    """Any number of hands with and without results, cameras, σ and residuals.

    Not yet their record: its type check draws random numbers, which strategies must not.
    """
    count = draw(st.integers(0, 4))
    flags = st.lists(st.booleans(), min_size=count, max_size=count)
    present, known, with_sigma, with_residual = (
        np.array(draw(flags), dtype=bool) for _ in range(4)
    )
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = draw(st.sampled_from([1e-6, 1.0, 1e4]))
    numbers = {}
    for key, shape in SHAPES.items():
        values = scale * random.normal(size=(count, *shape))
        values[~present] = np.nan
        numbers[key] = values
    numbers["sigma"][~with_sigma] = np.nan
    numbers["residual"][~with_residual] = np.nan
    terms = draw(st.lists(st.text(min_size=1, max_size=8), max_size=3, unique=True))
    loss = {term: np.where(present, scale * random.normal(size=count), np.nan) for term in terms}
    if terms and count:
        loss[terms[0]][0] = np.nan
    return dict(
        names=tuple(draw(st.lists(st.text(max_size=12), min_size=count, max_size=count))),
        sides=tuple(draw(st.lists(st.sampled_from(["left", "right"]), min_size=count, max_size=count))),
        fitted=present,
        intrinsics_known=known & present,
        loss=loss if present.any() else {},
        **numbers,
    )  # fmt: skip


def write(path: Path, *parts: HandRecords) -> Path:
    path.unlink(missing_ok=True)
    with writing_hands(path) as write_part:
        for part in parts:
            write_part(part)
    return path


@given(fields=fields_of_hands())
@settings(max_examples=60, deadline=None)
def test_what_is_read_is_what_was_written_to_the_last_decimal(
    fields: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> None:
    written = HandRecords(**fields)
    path = write(tmp_path_factory.mktemp("hands") / "any.json", written)
    found = read_hands(path)
    assert (found.names, found.sides) == (written.names, written.sides)
    assert found.fitted.tolist() == written.fitted.tolist()
    assert found.intrinsics_known.tolist() == written.intrinsics_known.tolist()
    for key in SHAPES:
        half = 0.5000001 * 10.0 ** -DECIMALS[key]
        expected = getattr(written, key)
        assert getattr(found, key).shape == expected.shape
        np.testing.assert_allclose(getattr(found, key), expected, rtol=1e-15, atol=half)
    assert list(found.loss) == list(written.loss)
    for term, values in written.loss.items():
        np.testing.assert_allclose(found.loss[term], values, rtol=1e-15, atol=0.5000001e-6)
    before = path.read_bytes()
    assert write(path, found).read_bytes() == before


def test_parts_make_one_list_with_a_hand_to_a_line(hand: HandModel, tmp_path: Path) -> None:
    part = fitted(hand).records()
    path = write(tmp_path / "hands.json", part, part)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines[-1]) == ("[", "]")
    assert len(lines) == 2 + 6
    assert [json.loads(line.rstrip(","))["name"] for line in lines[1:-1]] == [*part.names] * 2
    assert len(read_hands(path)) == 6


def test_plain_json_holds_the_hands_that_were_fitted(hand: HandModel, tmp_path: Path) -> None:
    """Read without the reader of the format, as a user's program does."""
    part = fitted(hand)
    path = write(tmp_path / "hands.json", part.records())
    content = json.loads(path.read_text(encoding="utf-8"))
    assert [list(entry) for entry in content] == [
        ["name", "side", "fitted", "landmarks_3d", "landmarks_2d", "joint_angles_degrees", "shape", "sigma",
         "residual", "camera", "loss"]
    ] * 3  # fmt: skip
    assert [entry["fitted"] for entry in content] == [True, True, False]
    found = part.prediction
    for index, entry in enumerate(content[:2]):
        parameters = found.parameters.select(slice(index, index + 1))
        for key, expected, tolerance in (
            ("landmarks_3d", found.landmarks_3d[index], 1e-7),
            ("landmarks_2d", found.landmarks_2d[index], 1e-4),
            ("shape", parameters.shape[0], 1e-5),
            ("sigma", found.log_sigma[index].exp(), 1e-4),
        ):
            np.testing.assert_allclose(entry[key], expected.double(), rtol=1e-6, atol=tolerance)
        radians = np.radians(entry["joint_angles_degrees"])
        np.testing.assert_allclose(radians, parameters.joint_angles[0], rtol=1e-6, atol=1e-5)
        camera = entry["camera"]
        assert list(camera) == ["rotation", "translation", "intrinsics", "known"]
        np.testing.assert_allclose(camera["rotation"], parameters.root_rotation[0], atol=1e-6)
        np.testing.assert_allclose(camera["translation"], parameters.translation[0], atol=1e-6)
        np.testing.assert_allclose(camera["intrinsics"], found.intrinsics[index], atol=1e-5)
        assert entry["loss"] == {"data": [1.0, 3.0][index], "pose": 0.0}
    assert read_hands(path).loss["data"].tolist()[:2] == [1.0, 3.0]


def test_the_names_beside_it_are_those_of_the_skeleton(tmp_path: Path) -> None:
    write_names(tmp_path / "joints.json")
    names = json.loads((tmp_path / "joints.json").read_text(encoding="utf-8"))
    assert (names["joints"], names["axes"]) == (list(ARTICULATED), list(AXES))
    assert names["landmarks"] == list(LANDMARKS)
    assert set(names["units"]) < {field.name for field in dataclasses.fields(HandRecords)}


def test_a_number_that_is_not_finite_is_not_written(hand: HandModel, tmp_path: Path) -> None:
    good = fitted(hand).records()
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
        (lambda a: a.pop("shape"), "hand 1: the hand is an object without shape; expected the keys name, "),
        (lambda a: a.update(extra=1), "hand 1: the hand is an object with the unknown key extra; expected"),
        (lambda a: a.update(name=3), "hand 1: name is 3; expected a string"),
        (lambda a: a.update(side="both"), "hand 1: side is both; expected 'left' or 'right'"),
        (lambda a: a.update(fitted=1), "hand 1: fitted is 1; expected true or false"),
        (lambda a: a.update(fitted=False), "landmarks_3d is .*; expected null, because 'fitted' is false"),
        (lambda a: a.update(shape=None), r"shape is null; expected finite numbers of shape \(10,\)"),
        (lambda a: a["shape"].pop(), r"shape is \[.*; expected finite numbers of shape \(10,\)"),
        (lambda a: a["landmarks_3d"][4].pop(), r"landmarks_3d is \[.*\.\.\.; expected finite numbers"),
        (lambda a: a["landmarks_2d"][4].insert(0, None), r"landmarks_2d is .*of shape \(21, 2\)"),
        (lambda a: a["landmarks_2d"].__setitem__(4, [None, 1.0]), r"expected finite .* \(21, 2\)"),
        (lambda a: a["landmarks_2d"].__setitem__(4, ["1", "2"]), r"expected finite .* \(21, 2\)"),
        (lambda a: a["shape"].__setitem__(4, 10**400), r"expected finite numbers of shape \(10,\)"),
        (lambda a: a.update(residual=True), "residual is true; expected a finite number"),
        (lambda a: a.update(camera=None), "'camera' is null; expected an object with the keys rotation, "),
        (lambda a: a["camera"].pop("known"), "'camera' is an object without known; expected the keys rot"),
        (lambda a: a["camera"].update(known=None), "known is null; expected true or false"),
        (lambda a: a["camera"].update(rotation=[1, 0, 0]), r"rotation is \[1, 0, 0\]; .* \(3, 3\)"),
        (lambda a: a.update(loss=[1.0]), r"loss is \[1.0\]; expected an object with a number per term"),
        (lambda a: a["loss"].update(data="x"), "data is x; expected a finite number"),
        (lambda a: a["loss"].pop("pose"), r"'loss' has the terms \['data'\]; expected \['data', 'pose'\]"),
    ],
)  # fmt: skip
def test_a_hand_that_is_not_of_the_format_is_refused_by_name(
    hand: HandModel, tmp_path: Path, spoil: Callable[[Entry], object], said: str
) -> None:
    entries = list(hand_entries(fitted(hand).records()))
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
        ("[3]", "hand 0: the hand is 3; expected an object with the keys name, side"),
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


def test_no_hand_is_read_as_no_hand(tmp_path: Path) -> None:
    found = read_hands(write(tmp_path / "hands.json"))
    assert len(found) == 0
    assert found.landmarks_3d.shape == (0, 21, 3)
    assert found.loss == {}


def test_null_is_read_as_not_a_number(hand: HandModel, tmp_path: Path) -> None:
    entries = list(hand_entries(fitted(hand).records()))
    entries[0].update(sigma=None, residual=None)
    entries[1]["loss"]["data"] = None
    path = tmp_path / "hands.json"
    path.write_text(json.dumps(entries), encoding="utf-8")
    found = read_hands(path)
    assert np.isnan(found.sigma[0]).all()
    assert np.isfinite(found.sigma[1]).all()
    assert math.isnan(found.residual[0])
    assert np.isnan(found.loss["data"][1:]).all()
    assert np.isnan(found.landmarks_3d[2]).all()
    assert found.intrinsics_known.tolist() == [True, True, False]


def test_the_format_needs_neither_torch_nor_opencv() -> None:
    program = (
        "import sys, hand_recon.fitting.hands_file\n"
        "print([name for name in ('torch', 'cv2', 'trimesh', 'hydra') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)  # noqa: S603  # fmt: skip
    assert done.stdout == "[]\n"
