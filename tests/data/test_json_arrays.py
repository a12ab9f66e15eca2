import json
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data import json_arrays
from hand_recon.data.json_arrays import load_json_array, parse_json_array, to_numbers
from tests.support.json_parsers import parser

pytestmark = pytest.mark.usefixtures(parser.__name__)


@pytest.mark.parametrize("shape", [(7,), (5, 4), (6, 21, 3), (3, 1, 61)])
@pytest.mark.parametrize("indent", [None, 1])
def test_reads_what_json_reads(tmp_path: Path, shape: tuple[int, ...], indent: int | None) -> None:
    array = np.random.default_rng(0).normal(size=shape)
    path = tmp_path / "array.json"
    path.write_text(json.dumps(array.tolist(), indent=indent))
    np.testing.assert_array_equal(parse_json_array(path), array.astype(np.float32))


@pytest.mark.parametrize("chunk", [1500, 1501, 1502, 1503, 4000])
def test_a_number_cut_by_the_end_of_a_chunk_is_whole(
    tmp_path: Path, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(json_arrays, "CHUNK", chunk)
    array = np.random.default_rng(0).normal(size=(30, 21, 3))
    path = tmp_path / "array.json"
    path.write_text(json.dumps(array.tolist()))
    np.testing.assert_array_equal(parse_json_array(path), array.astype(np.float32))


def test_nan_is_read_as_nan(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("[[NaN, 1.0], [2.0, 3.0]]")
    assert np.isnan(parse_json_array(tmp_path / "a.json")[0, 0])


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "[1, 2, 3", "[[1, 2], [3]]", "[[1, 2], [3, null]]", "[[1, 2], [3, 4],]",
     "[[1, 2], [3, 4]] x", "[[[1, 2], [3]]]", '["one"]', "[[]]", "[[1, 2], 3, 4]"],
)  # fmt: skip
def test_anything_else_is_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError, match=r"a.json is not a complete JSON list of equal arrays"):
        parse_json_array(tmp_path / "a.json")


@pytest.mark.parametrize(
    "text", ["0.1", "-0", "1e-7,2E+3,-4.25", "123456789012345678901234567890,1e400,-1e-400"]
)
def test_numbers_are_those_of_python_to_the_last_bit(text: str) -> None:
    numbers = to_numbers(text.encode())
    assert numbers.tolist() == [float(word) for word in text.split(",")]
    assert numbers.flags.writeable


@given(
    st.lists(
        st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**70), 2**70), min_size=1
    )
)
def test_both_parsers_read_any_numbers_as_python_does(numbers: list[float]) -> None:
    text = json.dumps(numbers, separators=(",", ":"))[1:-1].encode()
    with pytest.MonkeyPatch.context() as patch:
        found = to_numbers(text)
        patch.setattr(json_arrays, "SIMDJSON", None)
        assert to_numbers(text).tolist() == found.tolist() == [float(one) for one in numbers]


@pytest.mark.parametrize("text", ["", ",", "1,", "true", "null", '"1"', "1,,2", "1;2", "1,{}"])
def test_what_is_no_number_is_no_number_to_either_parser(text: str) -> None:
    with pytest.raises(ValueError, match=r"not a number|could not be read"):
        to_numbers(text.encode())


def test_a_file_is_parsed_once_until_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    path.write_text("[1, 2, 3]")
    first = load_json_array(path, tmp_path / "cache")
    with monkeypatch.context() as patch:
        patch.delattr(json_arrays, "parse_json_array")
        np.testing.assert_array_equal(load_json_array(path, tmp_path / "cache"), first)
    path.write_text("[1, 2, 4]")
    os.utime(path, ns=(1, 1))
    assert load_json_array(path, tmp_path / "cache").tolist() == [1, 2, 4]
