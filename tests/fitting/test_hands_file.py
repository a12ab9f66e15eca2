"""Round trip and contents of the file of hands."""

import dataclasses
import json
import math
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.fitting.hand_entry import CLIP, KEYS
from hand_recon.fitting.hand_records import CAMERAS, SHAPES, HandRecords, joined_records
from hand_recon.fitting.hands_file import (
    DECIMALS,
    finished_entries,
    hand_entries,
    read_hands,
    writing_hands,
)
from hand_recon.fitting.origin import Moment
from hand_recon.fitting.records_of_fits import to_records
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from tests.support.fitted_hands import fitted

MOMENTS = st.builds(
    Moment,
    hand=st.integers(1, 9),
    frame=st.integers(0, 10**7),
    time=st.floats(0, 1e5).map(lambda seconds: round(seconds, 6)),
    seen=st.booleans(),
)

SCHEMA = json.loads((files("hand_recon.fitting") / "hands.schema.json").read_text(encoding="utf-8"))


@st.composite
def fields_of_hands(draw: st.DrawFn) -> dict[str, Any]:
    """Any number of hands with and without results, cameras, σ and residuals.

    Not yet their record: its type check draws random numbers, which strategies must not.
    """
    count = draw(st.integers(0, 4))
    flags = st.lists(st.booleans(), min_size=count, max_size=count)
    present, with_sigma, with_residual, with_image = (
        np.array(draw(flags), dtype=bool) for _ in range(4)
    )
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = draw(st.sampled_from([1e-6, 1.0, 1e4]))
    numbers = {}
    for key, shape in SHAPES.items():
        values = scale * random.normal(size=(count, *shape))
        if key not in ("score", "observed_2d"):
            values[~present] = np.nan
        numbers[key] = values
    numbers["sigma_2d"][~with_sigma] = np.nan
    numbers["covariance_3d"][with_sigma] = np.nan
    numbers["residual"][~with_residual] = np.nan
    numbers["score"][with_residual] = np.nan
    numbers["observed_2d"][random.random((count, 21)) < 0.3] = np.nan
    terms = draw(st.lists(st.text(min_size=1, max_size=8), max_size=3, unique=True))
    loss = {term: np.where(present, scale * random.normal(size=count), np.nan) for term in terms}
    if terms and count:
        loss[terms[0]][0] = np.nan

    def texts(strategy: st.SearchStrategy[Any]) -> tuple[Any, ...]:
        return tuple(draw(st.lists(strategy, min_size=count, max_size=count)))

    return dict(
        names=texts(st.text(max_size=12)),
        images=texts(st.none() | st.text(max_size=12)),
        sides=texts(st.sampled_from(["left", "right"])),
        verdicts=tuple(
            draw(st.sampled_from(["plausible", "doubtful"])) if one else "not fitted"
            for one in present
        ),
        reasons=texts(st.lists(st.text(max_size=9), max_size=2).map(tuple)),
        cameras=tuple(draw(st.sampled_from(CAMERAS)) if one else None for one in present),
        image_sizes=tuple(
            (640, 480) if one and two else None
            for one, two in zip(present, with_image, strict=True)
        ),
        sources=texts(st.text(max_size=9)),
        hand_models=texts(st.sampled_from(["open", "mano"])),
        versions=texts(st.text(max_size=5)),
        moments=tuple(draw(st.none() | MOMENTS) for _ in range(count)),
        loss=loss if present.any() else {},
        **numbers,
    )


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
    for field in dataclasses.fields(HandRecords):
        if field.name not in (*SHAPES, "loss"):
            assert getattr(found, field.name) == getattr(written, field.name)
    assert found.fitted.tolist() == written.fitted.tolist()
    assert found.intrinsics_known.tolist() == written.intrinsics_known.tolist()
    jsonschema.validate(json.loads(path.read_text(encoding="utf-8")), SCHEMA)
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
    part = to_records(fitted(hand))
    path = write(tmp_path / "hands.json", part, part)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines[-1]) == ("[", "]")
    assert len(lines) == 2 + 6
    assert [json.loads(line.rstrip(","))["name"] for line in lines[1:-1]] == [*part.names] * 2
    assert len(read_hands(path)) == 6


def test_plain_json_holds_the_hands_that_were_fitted(hand: HandModel, tmp_path: Path) -> None:
    """Read without the reader of the format, as a user's program does."""
    part = fitted(hand)
    path = write(tmp_path / "hands.json", to_records(part))
    content = json.loads(path.read_text(encoding="utf-8"))
    assert [list(entry) for entry in content] == [
        ["image", "name", "side", "score", "verdict", "reasons", "landmarks_3d", "landmarks_2d",
         "observed_2d", "sigma_2d", "covariance_3d", "joint_angles_degrees", "shape", "root_rotation",
         "translation", "camera", "residual", "loss", "source", "hand_model", "version"]
    ] * 3  # fmt: skip
    assert [entry["verdict"] == "not fitted" for entry in content] == [False, False, True]
    assert content[0]["observed_2d"][5] is None
    found = part.prediction
    for index, entry in enumerate(content[:2]):
        parameters = found.parameters.select(slice(index, index + 1))
        for key, expected, tolerance in (
            ("landmarks_3d", found.landmarks_3d[index], 1e-7),
            ("landmarks_2d", found.landmarks_2d[index], 1e-4),
            ("shape", parameters.shape[0], 1e-5),
            ("sigma_2d", found.log_sigma[index].exp(), 1e-4),
        ):
            np.testing.assert_allclose(entry[key], expected.double(), rtol=1e-6, atol=tolerance)
        angles = entry["joint_angles_degrees"]
        assert list(angles) == list(ARTICULATED)
        radians = np.radians([[angles[joint][axis] for axis in AXES] for joint in ARTICULATED])
        np.testing.assert_allclose(radians, parameters.joint_angles[0], rtol=1e-6, atol=1e-5)
        camera = entry["camera"]
        assert (camera["source"], camera["image_size"]) == ("given", None)
        np.testing.assert_allclose(entry["root_rotation"], parameters.root_rotation[0], atol=1e-6)
        np.testing.assert_allclose(entry["translation"], parameters.translation[0], atol=1e-6)
        np.testing.assert_allclose(camera["intrinsics"], found.intrinsics[index], atol=1e-5)
        assert entry["loss"] == {"data": [1.0, 3.0][index], "pose": 0.0}
    assert read_hands(path).loss["data"].tolist()[:2] == [1.0, 3.0]


def test_the_schema_names_the_keys_in_their_order_and_refuses_what_the_reader_refuses(
    hand: HandModel,
) -> None:
    assert list(SCHEMA["$defs"]["hand"]["properties"]) == [*KEYS, CLIP]
    good = list(hand_entries(to_records(fitted(hand))))
    jsonschema.validate(good, SCHEMA)
    for key in KEYS:
        for wrong in ({**good[0], key: object}, {k: v for k, v in good[0].items() if k != key}):
            with pytest.raises(jsonschema.ValidationError):
                jsonschema.validate([wrong], SCHEMA)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate([{**good[2], "shape": [0.0] * 10}], SCHEMA)


def test_an_unfinished_file_is_read_as_far_as_its_lines_are_whole_and_gone_on_with(
    hand: HandModel, tmp_path: Path
) -> None:
    part = to_records(fitted(hand))
    whole = write(tmp_path / "whole.json", part, part).read_bytes()
    # All beginnings of the file that a kill can leave; a sample, and those about the ends of lines.
    ends = [at for at, byte in enumerate(whole) if byte == ord("\n")]
    cuts = {
        0,
        1,
        2,
        *range(0, len(whole), 997),
        *ends,
        *(end - 1 for end in ends),
        *(end + 1 for end in ends),
    }
    path = tmp_path / "hands.json"
    unfinished = tmp_path / "hands.json.part"
    for cut in sorted(cuts):
        unfinished.write_bytes(whole[:cut])
        done = list(finished_entries(unfinished))
        lines = whole[:cut].decode(errors="replace").splitlines()
        assert len(done) >= max(len(lines) - 2, 0)
        rest = list(hand_entries(joined_records([part, part])))[len(done) :]
        path.unlink(missing_ok=True)
        with writing_hands(path, [*done, *rest]):
            pass
        assert path.read_bytes() == whole


def test_no_hand_is_read_as_no_hand(tmp_path: Path) -> None:
    found = read_hands(write(tmp_path / "hands.json"))
    assert len(found) == 0
    assert found.landmarks_3d.shape == (0, 21, 3)
    assert found.loss == {}


def test_null_is_read_as_not_a_number(hand: HandModel, tmp_path: Path) -> None:
    entries = list(hand_entries(to_records(fitted(hand))))
    entries[0].update(sigma_2d=None, residual=None)
    entries[1]["loss"]["data"] = None
    path = tmp_path / "hands.json"
    path.write_text(json.dumps(entries), encoding="utf-8")
    found = read_hands(path)
    assert np.isnan(found.sigma_2d[0]).all()
    assert np.isfinite(found.sigma_2d[1]).all()
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
