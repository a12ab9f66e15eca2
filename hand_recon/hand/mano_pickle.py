"""Read MANO's pickle without running anything in it.

A pickle names functions and classes that its reader fetches and calls; MANO's names seven. Here none of
them is the real one: every name on the list stands for an inert record that keeps what it is given, any
other name is refused, and the numbers are taken out of the records afterwards. So neither chumpy, which no
current Python can install, nor scipy is needed.
"""

import io
import pickle
import pickletools
import re
from typing import Final

import numpy as np

MAX_BYTES: Final = 256 * 2**20
"""Largest pickle that is read; MANO's has 4 MB."""


class RefusedPickleError(ValueError):
    """The pickle asks for what no MANO file needs, or is none."""


class Inert:
    """Keeps what a pickle would have passed to a class, and does nothing with it."""

    __slots__ = ("arguments", "state")

    arguments: tuple[object, ...]
    state: object

    def __new__(cls, *arguments: object) -> "Inert":
        """Keep the arguments."""
        record = super().__new__(cls)
        record.arguments = arguments
        record.state = None
        return record

    def __setstate__(self, state: object) -> None:
        """Keep the state."""
        self.state = state


class _Type(Inert):
    """`numpy.ndarray`, which is only passed on."""

    __slots__ = ()


class _DType(Inert):
    """`numpy.dtype`."""

    __slots__ = ()


class _Array(Inert):
    """What `numpy.core.multiarray._reconstruct` makes."""

    __slots__ = ()


class _Scalar(Inert):
    """What `numpy.core.multiarray.scalar` makes."""

    __slots__ = ()


class _Buffer(Inert):
    """What `numpy.core.numeric._frombuffer` makes: arrays of protocol 5."""

    __slots__ = ()


class _Bytes(Inert):
    """What `_codecs.encode` makes: bytes that Python 3 writes for Python 2."""

    __slots__ = ()


class _Columns(Inert):
    """`scipy.sparse.csc_matrix`."""

    __slots__ = ()


class _Rows(Inert):
    """`scipy.sparse.csr_matrix`."""

    __slots__ = ()


class _Chumpy(Inert):
    """`chumpy.ch.Ch`: an array in its state's `x`."""

    __slots__ = ()


class _Select(Inert):
    """`chumpy.reordering.Select`: some entries of another array."""

    __slots__ = ()


class _Set(Inert):
    """`set`, which chumpy keeps its bookkeeping in."""

    __slots__ = ()


ALLOWED: Final[dict[tuple[str, str], type[Inert]]] = {
    ("numpy", "dtype"): _DType,
    ("numpy", "ndarray"): _Type,
    ("chumpy.ch", "Ch"): _Chumpy,
    ("chumpy.reordering", "Select"): _Select,
    ("__builtin__", "set"): _Set,
    ("builtins", "set"): _Set,
    ("_codecs", "encode"): _Bytes,
    **{(f"numpy.{c}.multiarray", "_reconstruct"): _Array for c in ("core", "_core")},
    **{(f"numpy.{c}.multiarray", "scalar"): _Scalar for c in ("core", "_core")},
    **{(f"numpy.{c}.numeric", "_frombuffer"): _Buffer for c in ("core", "_core")},
    **{(f"scipy.sparse.{m}", "csc_matrix"): _Columns for m in ("csc", "_csc")},
    **{(f"scipy.sparse.{m}", "csr_matrix"): _Rows for m in ("csr", "_csr")},
}
"""The seven globals of MANO's files, and the names that newer Pythons and scipys give them."""


class _Unpickler(pickle.Unpickler):  # noqa: S301  # of records that do nothing
    """Finds the records of `ALLOWED` and nothing else."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(io.BytesIO(data), encoding="latin1")
        self.name = name

    def find_class(self, module: str, name: str) -> type[Inert]:
        if (module, name) not in ALLOWED:
            raise RefusedPickleError(
                f"{self.name} is refused: the pickle asks for {module}.{name}, which no MANO file "
                "needs. Nothing of it was run. Take the file from MANO's own download."
            )
        return ALLOWED[module, name]


def load_pickle(data: bytes, name: str) -> dict[str, object]:
    """The dictionary in a pickle, its values still in records: `to_array` takes the numbers out.

    Args:
        data: The file's content.
        name: The file's name, for messages.

    Raises:
        RefusedPickleError: It asks for more than MANO's files do, is damaged, or holds no dictionary.
    """
    if len(data) > MAX_BYTES:
        raise RefusedPickleError(
            f"{name} has {len(data)} bytes, more than any MANO file: not read."
        )
    try:
        _scan(data, name)
        content = _Unpickler(data, name).load()
    except RefusedPickleError:
        raise
    except Exception as error:
        # Damaged bytes raise nearly any exception: what they have in common is that this is no pickle.
        raise RefusedPickleError(
            f"{name} cannot be read as a pickle ({type(error).__name__}: {error}). Nothing of it was "
            "run. Is the download complete?"
        ) from error
    if not isinstance(content, dict):
        raise RefusedPickleError(
            f"{name} holds a {type(content).__name__}, expected MANO's dictionary."
        )
    return {str(key): value for key, value in content.items()}


def to_array(value: object) -> np.ndarray:
    """The numbers of a record.

    Raises:
        TypeError: It is none that holds numbers, or it contradicts itself.
    """
    if isinstance(value, Inert) and type(value) in _CONVERTERS:
        return np.asarray(_CONVERTERS[type(value)](value))
    if isinstance(value, bool | int | float):
        return np.asarray(value)
    if isinstance(value, list | tuple):
        return np.array([to_array(entry) for entry in value])
    raise TypeError(f"a {type(value).__name__} holds no numbers")


def _scan(data: bytes, name: str) -> None:
    """Refuse opcodes that could pass by `find_class`, or ask for memory without end.

    Extension codes fetch what the process has registered, and may find it in a cache.
    """
    for opcode, argument, _ in pickletools.genops(data):
        outside = opcode.name in ("EXT1", "EXT2", "EXT4", "PERSID", "BINPERSID", "NEXT_BUFFER")
        endless = opcode.name in ("PUT", "LONG_BINPUT") and int(argument or 0) > len(data)
        if outside or endless:
            raise RefusedPickleError(
                f"{name} is refused: the pickle uses {opcode.name} {argument}, which no MANO file "
                "needs. Nothing of it was run."
            )


def _dtype(record: object) -> np.dtype:
    if not isinstance(record, _DType) or not record.arguments:
        raise TypeError("an array without a type")
    code = str(record.arguments[0])
    if not re.fullmatch(r"[<>|=]?[fiub][1248]", code):
        raise TypeError(f"an array of type {code!r}, which is no number")
    dtype = np.dtype(code)
    state = record.state
    if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">"):
        dtype = dtype.newbyteorder(state[1])
    return dtype


def _raw(value: object) -> bytes:
    """The bytes of an array, in any of the ways that Pythons have written them."""
    if isinstance(value, bytes | bytearray):
        return bytes(value)
    if isinstance(value, str):
        return value.encode("latin1")
    if isinstance(value, _Bytes) and value.arguments[1:] in (("latin1",), ("latin-1",)):
        return str(value.arguments[0]).encode("latin1")
    raise TypeError(f"an array whose numbers are a {type(value).__name__}")


def _numbers(raw: object, dtype: object, shape: object, order: str) -> np.ndarray:
    sizes = shape if isinstance(shape, tuple) else (shape,)
    if not all(isinstance(size, int) and size >= 0 for size in sizes):
        raise TypeError(f"an array of shape {shape!r}")
    flat = np.frombuffer(_raw(raw), _dtype(dtype))
    if flat.size != np.prod(sizes, dtype=float):
        raise TypeError(f"an array of shape {shape!r} with {flat.size} numbers")
    native = flat.astype(flat.dtype.newbyteorder("="))
    return native.reshape(sizes, order="F" if order == "F" else "C")


def _array(record: Inert) -> np.ndarray:
    state = record.state
    if not isinstance(state, tuple) or len(state) != 5:
        raise TypeError("an array without content")
    _, shape, dtype, fortran, raw = state
    return _numbers(raw, dtype, shape, "F" if fortran else "C")


def _buffer(record: Inert) -> np.ndarray:
    raw, dtype, shape, order = record.arguments
    return _numbers(raw, dtype, shape, str(order))


def _scalar(record: Inert) -> np.ndarray:
    dtype, raw = record.arguments
    return _numbers(raw, dtype, (), "C")


def _state_of(record: Inert) -> dict[str, object]:
    if not isinstance(record.state, dict):
        raise TypeError(f"a {type(record).__name__.strip('_')} without content")
    return record.state


def _select(record: Inert) -> np.ndarray:
    """`ravel(a)[idxs]`, in the shape that it names."""
    state = _state_of(record)
    chosen = to_array(state.get("a")).ravel()[to_array(state.get("idxs")).astype(np.int64)]
    shape = state.get("preferred_shape")
    return chosen if shape is None else chosen.reshape(to_array(shape).astype(np.int64).tolist())


def _sparse(record: Inert) -> np.ndarray:
    """A compressed sparse matrix, written out."""
    state = _state_of(record)
    rows, columns = (int(size) for size in to_array(state.get("_shape", state.get("shape"))))
    by_rows = isinstance(record, _Rows)
    lines, width = (rows, columns) if by_rows else (columns, rows)
    data, indices, starts = (to_array(state.get(name)) for name in ("data", "indices", "indptr"))
    counts = np.diff(starts)
    whole = len(counts) == lines and counts.min() >= 0 and counts.sum() == len(data)
    if not whole or lines * width * 8 > MAX_BYTES or indices.min() < 0:
        raise TypeError(f"a sparse matrix of {rows} × {columns} that contradicts itself")
    dense = np.zeros((lines, width))
    line = np.repeat(np.arange(lines), counts)
    np.add.at(dense, (line, indices), data)
    return dense if by_rows else dense.T


_CONVERTERS: Final = {
    _Array: _array,
    _Buffer: _buffer,
    _Scalar: _scalar,
    _Chumpy: lambda record: to_array(_state_of(record).get("x")),
    _Select: _select,
    _Columns: _sparse,
    _Rows: _sparse,
}
