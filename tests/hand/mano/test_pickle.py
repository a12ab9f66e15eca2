"""MANO's pickle is read exactly, and no pickle can run code."""

import copyreg
import os
import pickle
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.hand.mano.inert_pickle import Record, RefusedPickleError
from hand_recon.hand.mano.pickle_file import ALLOWED, load_pickle, to_array
from hand_recon.hand.mano.pickled_arrays import NoNumbersError
from tests.support.mano_file import Named, mano_arrays, mano_pickle, opcodes

ORIGINAL = b"\x80\x02%s."


def _text(value: str) -> bytes:
    return b"X" + struct.pack("<i", len(value)) + value.encode()


def _global(module: str, name: str) -> bytes:
    return b"c" + f"{module}\n{name}\n".encode()


class _Reduced:
    """Object that is pickled as a call."""

    def __init__(self, *call: object) -> None:
        self.call = call

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return self.call[0], self.call[1:]


def attacks(marker: Path) -> dict[str, bytes]:
    """Pickles that create the marker file in different ways if Python's unpickler reads them."""
    touch = f"touch {marker}"
    code = f"__import__('pathlib').Path({str(marker)!r}).touch()"
    call = b"(" + _text(touch) + b"tR."
    evaluate = b"(" + _text(code) + b"tR."
    inner = b"\x80\x02" + _global("os", "system") + call
    return {
        "os.system": b"\x80\x02" + _global("os", "system") + call,
        "posix.system by __reduce__": pickle.dumps(_Reduced(os.system, touch)),
        "protocol 0": b"cos\nsystem\n(S'" + touch.encode() + b"'\ntR.",
        "INST": b"(S'" + touch.encode() + b"'\nios\nsystem\n.",
        "OBJ": b"(" + _global("subprocess", "Popen") + b"(" + _text("touch") + _text(str(marker)) + b"lo.",
        "eval": b"\x80\x02" + _global("builtins", "eval") + evaluate,
        "Python 2's eval": b"\x80\x02" + _global("__builtin__", "eval") + evaluate,
        "exec": pickle.dumps(_Reduced(exec, code)),
        "getattr": b"\x80\x02" + _global("builtins", "getattr") + b"(" + _global("os", "x")
        + _text("system") + b"tR" + call,
        "another name in an allowed module": b"\x80\x02"
        + _global("numpy.core.multiarray", "frombuffer") + call,
        "numpy's own import of os": b"\x80\x02" + _global("numpy", "os") + call,
        "a dotted name": b"\x80\x04" + _text("numpy") + _text("ndarray.os.system") + b"\x93" + call,
        "a dotted name in the records": b"\x80\x04" + _text("chumpy.ch")
        + _text("Ch.__setstate__.__globals__") + b"\x93.",
        "this project's own reader": b"\x80\x02" + _global("hand_recon.hand.mano.pickle_file", "load_pickle")
        + b"(C" + bytes([len(inner)]) + inner + _text("x") + b"tR.",
        "pickle in pickle": b"\x80\x03" + _global("pickle", "loads")
        + b"(C" + bytes([len(inner)]) + inner + b"tR.",
        "inside MANO's dictionary": b"\x80\x02}(" + opcodes("v_template") + _global("os", "system")
        + b"(" + _text(touch) + b"tR" + b"u.",
        "persistent name": b"\x80\x02Pos.system\n.",
        "in an array's state": b"\x80\x02" + opcodes(Named("chumpy.ch Ch", {}))
        + b"}(" + _text("x") + _global("os", "system") + b"(" + _text(touch) + b"tR" + b"ub.",
    }  # fmt: skip


@pytest.mark.parametrize("name", attacks(Path("x")))
def test_a_pickle_that_names_another_function_is_refused_and_runs_nothing(
    name: str, tmp_path: Path
) -> None:
    marker = tmp_path / "marker"
    with pytest.raises(RefusedPickleError, match="Nothing of it was run"):
        load_pickle(attacks(marker)[name], "bad.pkl")
    assert not marker.exists()


@pytest.mark.parametrize("name", ["os.system", "posix.system by __reduce__", "eval", "INST"])
def test_the_attacks_are_real(name: str, tmp_path: Path) -> None:
    """Python's unpickler does create the marker file, so the test above can fail."""
    marker = tmp_path / "marker"
    pickle.loads(attacks(marker)[name])  # noqa: S301  # the content is written above
    assert marker.exists()


def test_the_refusal_names_the_global_and_the_file() -> None:
    with pytest.raises(RefusedPickleError, match=r"hand\.pkl is refused: .* asks for os\.system,"):
        load_pickle(b"\x80\x02" + _global("os", "system") + b".", "hand.pkl")


@pytest.fixture
def extension() -> Iterator[int]:
    """Registers and uses an extension code for os.system, so that it is cached."""
    code = 219
    copyreg.add_extension("os", "system", code)
    pickle.loads(b"\x80\x02\x82" + bytes([code]) + b".")  # noqa: S301  # fills the cache
    yield code
    copyreg.remove_extension("os", "system", code)


def test_an_extension_code_does_not_bypass_the_list(extension: int, tmp_path: Path) -> None:
    marker = tmp_path / "marker"
    data = b"\x80\x02\x82" + bytes([extension]) + b"(" + _text(f"touch {marker}") + b"tR."
    with pytest.raises(RefusedPickleError, match="uses EXT1 219"):
        load_pickle(data, "bad.pkl")
    assert not marker.exists()


@pytest.mark.parametrize("allowed", sorted(ALLOWED))
def test_a_pickle_cannot_redefine_its_allowed_names(allowed: tuple[str, str]) -> None:
    before = dict(vars(Record))
    data = b"\x80\x02" + _global(*allowed) + b"}(" + _text("__setstate__") + b"Nub."
    with pytest.raises(RefusedPickleError, match="gives a state to a _Name"):
        load_pickle(data, "bad.pkl")
    with_slots = data.replace(b"ub.", b"u" + b"}(" + _text("state") + b"Nu\x86b.")
    with pytest.raises(RefusedPickleError):
        load_pickle(with_slots, "bad.pkl")
    assert dict(vars(Record)) == before


def test_a_record_only_stores_its_state() -> None:
    """A state that would set attributes or methods is stored as a value."""
    state = {"__class__": 1, "to_array": 2, "x": 3}
    content = load_pickle(ORIGINAL % opcodes({"a": Named("chumpy.ch Ch", state)}), "a.pkl")
    record = content["a"]
    assert isinstance(record, Record)
    assert record.state == state
    assert not hasattr(record, "__dict__")
    assert to_array(record) == 3


def test_a_memo_of_two_thousand_million_entries_is_refused() -> None:
    with pytest.raises(RefusedPickleError, match="LONG_BINPUT 2147483647"):
        load_pickle(b"\x80\x02}r" + struct.pack("<I", 2**31 - 1) + b".", "bad.pkl")


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    for content in (data, b"\x80\x02}" + data, mano_pickle_head() + data):
        try:
            load_pickle(content, "noise.pkl")
        except RefusedPickleError as error:
            assert "noise.pkl" in str(error)  # noqa: PT017  # random bytes need not be refused


def mano_pickle_head() -> bytes:
    return (ORIGINAL % opcodes({"a": np.arange(3)}))[:-20]


def test_a_pickle_without_a_dictionary_is_refused() -> None:
    with pytest.raises(RefusedPickleError, match="holds a list, expected a dictionary"):
        load_pickle(b"\x80\x02].", "list.pkl")


def test_every_array_of_manos_pickle_is_read_exactly() -> None:
    arrays = mano_arrays()
    content = load_pickle(mano_pickle(arrays), "MANO_RIGHT.pkl")
    for key, expected in arrays.items():
        np.testing.assert_array_equal(to_array(content[key]), expected, err_msg=key)
    assert content["bs_style"] == "lbs"


def test_select_takes_entries_of_the_flattened_array() -> None:
    """Computed by hand: entries 5, 0, 3, 2 of 10…15, in two rows."""
    inner = Named("chumpy.ch Ch", {"x": np.arange(10.0, 16.0).reshape(2, 3)})
    select = Named(
        "chumpy.reordering Select",
        {"a": inner, "idxs": np.array([5, 0, 3, 2]), "preferred_shape": (2, 2)},
    )
    content = load_pickle(ORIGINAL % opcodes({"a": select}), "a.pkl")
    np.testing.assert_array_equal(to_array(content["a"]), [[15.0, 10.0], [13.0, 12.0]])


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_files_saved_again_by_python_3_are_read(protocol: int) -> None:
    """Each protocol writes arrays, bytes and sparse matrices differently."""
    matrix = scipy.sparse.random(16, 40, density=0.2, random_state=np.random.default_rng(0))
    saved = {
        "plain": np.random.default_rng(1).normal(size=(4, 3)),
        "by columns": np.asfortranarray(np.arange(12, dtype=np.uint32).reshape(3, 4)),
        "other end first": np.arange(5, dtype=">f4"),
        "columns": matrix.tocsc(),
        "rows": matrix.tocsr(),
        "number": np.float64(2.5),
        "list": [[1, 2], [3, 4]],
    }
    content = load_pickle(pickle.dumps(saved, protocol=protocol), "MANO_RIGHT_np.pkl")
    for key, value in saved.items():
        expected = value.toarray() if scipy.sparse.issparse(value) else np.asarray(value)
        np.testing.assert_array_equal(to_array(content[key]), expected, err_msg=key)


def _objects() -> bytes:
    return pickle.dumps({"a": np.array([{}, None], dtype=object)}, protocol=2)


def _short() -> bytes:
    return (ORIGINAL % opcodes({"a": np.zeros(4)})).replace(
        opcodes((4,)), opcodes((40_000_000,)), 1
    )


def _sparse(**changes: object) -> bytes:
    state = {
        "_shape": (2, 2),
        "data": np.ones(2),
        "indices": np.array([0, 1]),
        "indptr": np.array([0, 1, 2]),
    }
    return ORIGINAL % opcodes({"a": Named("scipy.sparse.csc csc_matrix", state | changes)})


def _cycle() -> bytes:
    ch = opcodes(Named("chumpy.ch Ch", {}))[:-4]
    return b"\x80\x02}(" + opcodes("a") + ch + b"q\x00}(" + opcodes("x") + b"h\x00ubu."


@pytest.mark.parametrize(
    "data",
    [
        _objects(),
        _short(),
        _sparse(indptr=np.array([0, 2**40, 2])),
        _sparse(indices=np.array([-1, 0])),
        _sparse(indices=np.array([5, 0])),
        _sparse(_shape=(2**30, 2)),
        _sparse(data=np.ones(1)),
        _cycle(),
        ORIGINAL % opcodes({"a": "text"}),
        ORIGINAL % opcodes({"a": None}),
        ORIGINAL % opcodes({"a": Named("chumpy.ch Ch", {"y": 1})}),
        pickle.dumps({"a": np.array(["text"])}, protocol=2),
    ],
)
def test_records_that_hold_no_numbers_give_none(data: bytes) -> None:
    record = load_pickle(data, "a.pkl")["a"]
    with pytest.raises(NoNumbersError, match=r"^an? "):
        to_array(record)
