"""HO3D's pickles give their numbers, and no code in them is ever executed."""

import contextlib
import copyreg
import io
import os
import pickle
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.ho3d import metas
from hand_recon.data.ho3d.metas import RefusedMetaError, read_meta
from tests.support.inert_pickles import HOSTILE_PICKLES, HOSTILE_VALUES, entry
from tests.support.mano_file import opcodes

NUMBERS = np.arange(63.0).reshape(21, 3) - 0.25


def write(path: Path, content: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(content, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_arrays_of_every_protocol_come_back(tmp_path: Path, protocol: int) -> None:
    entries = {
        "handJoints3D": NUMBERS.astype(np.float32),
        "columns": np.asfortranarray(NUMBERS),
        "big": NUMBERS.astype(">f8"),
        "box": [np.int64(3), 4, 5.5, 6],
        "scalar": np.float64(0.5),
        "name": "021_bleach_cleanser",
    }
    meta = read_meta(write(tmp_path / "0000.pkl", entries, protocol))
    for key in ("handJoints3D", "columns", "big"):
        np.testing.assert_array_equal(meta.numbers(key, (21, 3)), NUMBERS)
    np.testing.assert_array_equal(meta.numbers("box", (4,)), [3, 4, 5.5, 6])
    assert meta.numbers("scalar", ()) == 0.5


def test_what_python_2_wrote_is_read(tmp_path: Path) -> None:
    """Byte strings, and numpy's old module names."""
    content: dict[str, object] = {"handJoints3D": NUMBERS, "objName": "banana", "handBeta": None}
    path = tmp_path / "0000.pkl"
    path.write_bytes(b"\x80\x02" + opcodes(content) + b".")
    meta = read_meta(path)
    np.testing.assert_array_equal(meta.numbers("handJoints3D", (21, 3)), NUMBERS)
    assert meta.numbers("handBeta", (10,)) is None


@pytest.mark.parametrize("nothing", [None, np.array(None), np.array([None, None])])
def test_none_is_no_annotation_and_no_zero(tmp_path: Path, nothing: object) -> None:
    meta = read_meta(write(tmp_path / "0000.pkl", {"handJoints3D": nothing}))
    assert meta.numbers("handJoints3D", (21, 3)) is None


class Runs:
    """A pickle that makes a folder when it is read."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("place", ["entry", "inside an array", "instead of a dictionary"])
def test_nothing_in_a_meta_is_run(tmp_path: Path, place: str) -> None:
    marker = tmp_path / "it ran"
    content: object = {
        "entry": {"handJoints3D": NUMBERS, "more": Runs(marker)},
        "inside an array": {"handJoints3D": np.array([Runs(marker), 1.0])},
        "instead of a dictionary": Runs(marker),
    }[place]
    path = write(tmp_path / "0000.pkl", content)
    with pytest.raises(RefusedMetaError, match=r"0000\.pkl is refused: .* asks for posix\.mkdir"):
        read_meta(path)
    assert not marker.exists()
    # The ordinary reader does execute it.
    pickle.loads(path.read_bytes())  # noqa: S301  # the test's own
    assert marker.exists()


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("builtins", "eval"), ("__builtin__", "apply"), ("numpy", "load"), ("numpy", "dtype.type"),
        ("numpy.core.multiarray", "fromfile"), ("numpy", "memmap"), ("_codecs", "lookup"),
        ("numpy.testing._private.utils", "runstring"), ("functools", "partial"), ("posix", "system"),
    ],
)  # fmt: skip
def test_every_other_name_is_refused_by_name(tmp_path: Path, module: str, name: str) -> None:
    path = tmp_path / "0007.pkl"
    path.write_bytes(b"\x80\x02c" + f"{module}\n{name}\n".encode() + b")R.")
    with pytest.raises(RefusedMetaError, match=rf"0007\.pkl is refused.*{module}\.{name}"):
        read_meta(path)


def test_an_allowed_name_cannot_be_taken_for_its_attributes(tmp_path: Path) -> None:
    """Protocol 4 allows dotted names: `numpy.dtype.__new__` is not one of the six."""
    path = tmp_path / "0000.pkl"
    path.write_bytes(b"\x80\x04\x8c\x05numpy\x8c\x0ddtype.__new__\x93.")
    with pytest.raises(RefusedMetaError, match=r"numpy\.dtype\.__new__"):
        read_meta(path)


@pytest.mark.parametrize(
    "form",
    [
        # A state for the function itself, in a dictionary and as slots.
        b"cnumpy\ndtype\n}X\x04\x00\x00\x00evilK\x01sb.",
        b"cnumpy.core.multiarray\nscalar\nN}X\x08\x00\x00\x00__init__K\x01s\x86b.",
        b"c_codecs\nencode\n}X\x04\x00\x00\x00evilK\x01sb.",
        # A class of codes that the process has registered, an object of the outside, memory without end.
        b"\x82\x01.",
        b"Pevil\n.",
        b"}r\xff\xff\xff\x7f.",
    ],
)
def test_no_state_is_forced_upon_what_is_there(tmp_path: Path, form: bytes) -> None:
    path = tmp_path / "0000.pkl"
    path.write_bytes(b"\x80\x02" + form)
    with pytest.raises(RefusedMetaError, match=r"Nothing of it was run"):
        read_meta(path)


def test_codes_that_the_process_knows_are_refused_too(tmp_path: Path) -> None:
    copyreg.add_extension("os", "mkdir", 201)
    try:
        path = tmp_path / "0000.pkl"
        marker = tmp_path / "it ran"
        path.write_bytes(b"\x80\x02\x82\xc9" + opcodes((str(marker),)) + b"R.")
        with pytest.raises(RefusedMetaError, match="EXT1 201"):
            read_meta(path)
        assert not marker.exists()
    finally:
        copyreg.remove_extension("os", "mkdir", 201)


def test_arrays_of_objects_and_of_the_wrong_size_are_no_numbers(tmp_path: Path) -> None:
    odd = np.array([{"a": 1}, "text"], dtype=object)
    meta = read_meta(write(tmp_path / "0000.pkl", {"odd": odd, "text": np.array(["a"]), "s": "x"}))
    for key in ("odd", "text", "s"):
        with pytest.raises(RefusedMetaError, match=rf"0000\.pkl: {key}: an? "):
            meta.numbers(key, (2,))
    content = pickle.dumps({"short": np.zeros(3)}, protocol=4).replace(b"K\x03\x85", b"K\xff\x85")
    (tmp_path / "1.pkl").write_bytes(content)
    with pytest.raises(RefusedMetaError, match=r"shape \(255,\) in 24 bytes"):
        read_meta(tmp_path / "1.pkl").numbers("short", (3,))


def test_missing_keys_and_other_shapes_say_what_is_there(tmp_path: Path) -> None:
    meta = read_meta(write(tmp_path / "0000.pkl", {"handJoints3D": np.zeros(3)}))
    with pytest.raises(RefusedMetaError, match=r"has no camMat; it has \['handJoints3D'\]"):
        meta.numbers("camMat", (3, 3))
    with pytest.raises(RefusedMetaError, match=r"shape \(3,\), expected \(21, 3\).*right folders"):
        meta.numbers("handJoints3D", (21, 3))


WHOLE = pickle.dumps({"handJoints3D": NUMBERS, "camMat": np.eye(3)}, protocol=2)


@given(st.integers(0, len(WHOLE) - 1), st.integers(0, 255))
def test_damaged_files_are_named(
    tmp_path_factory: pytest.TempPathFactory, place: int, byte: int
) -> None:
    """A file cut off or with one byte changed gives numbers or a refusal, and no other error."""
    folder = tmp_path_factory.mktemp("metas")
    cut, changed = folder / "cut.pkl", folder / "changed.pkl"
    cut.write_bytes(WHOLE[:place])
    with pytest.raises(RefusedMetaError, match=r"cut\.pkl"):
        read_meta(cut)
    changed.write_bytes(WHOLE[:place] + bytes([byte]) + WHOLE[place + 1 :])
    # Only a refusal is let through: any other error fails the test.
    with contextlib.suppress(RefusedMetaError):
        read_meta(changed).numbers("handJoints3D", (21, 3))


def test_a_huge_file_is_not_even_read_as_a_pickle(tmp_path: Path) -> None:
    path = tmp_path / "0000.pkl"
    with io.FileIO(path, "w") as stream:
        stream.truncate(2**24 + 1)
    with pytest.raises(RefusedMetaError, match="16777217 bytes"):
        read_meta(path)


@pytest.mark.parametrize("name", HOSTILE_VALUES)
def test_a_tiny_meta_of_endless_values_is_refused_at_once(tmp_path: Path, name: str) -> None:
    path = tmp_path / "0000.pkl"
    path.write_bytes(entry(HOSTILE_VALUES[name], "camMat"))
    tracemalloc.start()
    began = time.process_time()
    try:
        meta = read_meta(path)
        with pytest.raises(RefusedMetaError, match=r"0000\.pkl: camMat: an? .{3,500}$"):
            meta.numbers("camMat", (3, 3))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert time.process_time() - began < 3
    assert peak < 64 * 2**20 + 4 * path.stat().st_size


@pytest.mark.parametrize("name", HOSTILE_PICKLES)
def test_no_key_of_a_meta_is_hashed_but_text(tmp_path: Path, name: str) -> None:
    path = tmp_path / "0000.pkl"
    path.write_bytes(HOSTILE_PICKLES[name])
    began = time.process_time()
    with pytest.raises(RefusedMetaError, match=r"0000\.pkl is refused: "):
        read_meta(path)
    assert time.process_time() - began < 3


def test_a_meta_of_too_many_instructions_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metas, "MAX_OPERATIONS", 1000)
    path = tmp_path / "0000.pkl"
    path.write_bytes(999 * b"]" + b"}.")
    with pytest.raises(RefusedMetaError, match=r"0000\.pkl .*more than 1000 instructions"):
        read_meta(path)


@pytest.mark.parametrize("module", ["chumpy.ch Ch", "scipy.sparse.csc csc_matrix", "builtins set"])
def test_what_manos_pickles_may_ask_for_no_meta_may(tmp_path: Path, module: str) -> None:
    path = tmp_path / "0000.pkl"
    path.write_bytes(b"\x80\x02c" + module.replace(" ", "\n").encode() + b"\n)R.")
    with pytest.raises(RefusedMetaError, match="asks for " + module.replace(" ", r"\.")):
        read_meta(path)
