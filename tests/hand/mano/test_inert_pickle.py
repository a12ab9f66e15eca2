"""Small hostile pickles are refused quickly, and plain ones are read as by Python."""

import pickle
import time
import tracemalloc

import numpy as np
import pytest

from hand_recon.hand.mano import pickle_file as mano_pickle_module
from hand_recon.hand.mano.conversion import convert_pickle
from hand_recon.hand.mano.inert_pickle import RefusedPickleError
from hand_recon.hand.mano.pickle_file import load_pickle, to_array
from hand_recon.hand.mano.pickled_arrays import NoNumbersError
from tests.support.inert_pickles import (
    HOSTILE_PICKLES,
    HOSTILE_VALUES,
    chumpy,
    entry,
    laughs,
    repeated,
)
from tests.support.mano_file import Named, mano_arrays, mano_pickle, opcodes

SELECTED = {"a": np.zeros(1), "idxs": np.zeros(131072, np.int64)}
WIDE = {
    "_shape": (1, 1_000_000),
    "data": np.ones(1),
    "indices": np.array([0]),
    "indptr": np.array([0, 1]),
}
REPEATED = {
    "of a selection": repeated(opcodes(Named("chumpy.reordering Select", SELECTED)), 1000),
    "of a wide matrix": repeated(opcodes(Named("scipy.sparse.csr csr_matrix", WIDE)), 1000),
    "of chumpy's own": chumpy(repeated(opcodes(np.zeros(131072)), 1000)),
    "of a selection by endless tuples": opcodes(Named("chumpy.reordering Select", {}))[:-4]
    + b"}(" + opcodes("a") + laughs() + opcodes("idxs") + laughs() + b"ub",
}  # fmt: skip


@pytest.mark.parametrize("name", [*HOSTILE_VALUES, *REPEATED])
def test_a_small_pickle_of_huge_values_is_refused_quickly(name: str) -> None:
    data = entry((HOSTILE_VALUES | REPEATED)[name])
    tracemalloc.start()
    began = time.process_time()
    try:
        value = load_pickle(data, "a.pkl")["a"]
        with pytest.raises(NoNumbersError, match=r"^an? .{3,300}$"):
            to_array(value)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert time.process_time() - began < 3
    assert peak < 64 * 2**20 + 4 * len(data)


@pytest.mark.parametrize("name", HOSTILE_PICKLES)
def test_only_text_is_hashed(name: str) -> None:
    began = time.process_time()
    with pytest.raises(RefusedPickleError, match=r"a\.pkl is refused: .*(for a key|FROZENSET)"):
        load_pickle(HOSTILE_PICKLES[name], "a.pkl")
    assert time.process_time() - began < 3


def test_a_pickle_of_too_many_instructions_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each instruction can allocate a hundred bytes; the empty dictionary takes two instructions."""
    monkeypatch.setattr(mano_pickle_module, "MAX_OPERATIONS", 1000)
    assert load_pickle(998 * b"]" + b"}.", "a.pkl") == {}
    with pytest.raises(RefusedPickleError, match="has more than 1000 instructions"):
        load_pickle(999 * b"]" + b"}.", "a.pkl")


def test_an_array_as_large_as_manos_is_read_from_lists() -> None:
    """MANO's largest array, the pose directions, has 778 × 3 × 135 numbers."""
    expected = np.random.default_rng(3).normal(size=(778, 3, 135))
    content = load_pickle(pickle.dumps({"posedirs": expected.tolist()}), "a.pkl")
    np.testing.assert_array_equal(to_array(content["posedirs"]), expected)


@pytest.mark.parametrize("protocol", range(6))
def test_plain_values_are_what_python_reads(protocol: int) -> None:
    """The interpreter gives the same values as Python's unpickler."""
    shared: list[object] = [1, 2.5, -3, 2**40, 2**100, "text", "ümläut", None, True]
    # Lower protocols write bytes as calls of a codec, and bytearrays as calls of their class.
    shared += [b"bytes"] * (protocol > 2) + [bytearray(b"more")] * (protocol > 4)
    plain = {
        "shared": shared, "again": shared, "tuples": [(), (1,), (1, 2), (1, 2, 3), (1, 2, 3, 4)],
        "deep": {"one": {"two": [False, {}, []]}}, "long": list(range(2500)), "last": "x" * 300,
    }  # fmt: skip
    content = load_pickle(pickle.dumps(plain, protocol), "a.pkl")
    assert content == plain
    assert content["shared"] is content["again"]


def test_a_conversion_names_the_file_and_the_array() -> None:
    arrays: dict[str, object] = dict(mano_arrays())
    marker = "PLACE FOR ANOTHER VALUE"
    data = mano_pickle(arrays | {"hands_mean": marker})  # type: ignore[arg-type]
    for name in ("a huge number beside a small one", "a huge number", "tuples of tuples"):
        changed = data.replace(opcodes(marker), HOSTILE_VALUES[name])
        with pytest.raises(RefusedPickleError, match=r"^MANO_RIGHT\.pkl: hands_mean: an? "):
            convert_pickle(changed, "MANO_RIGHT.pkl")
