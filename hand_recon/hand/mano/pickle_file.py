"""Reading of MANO's pickle without running any code in it.

A pickle names functions and classes that Python's unpickler imports and calls; MANO's names seven. Here each
of these names becomes an inert record (`inert_pickle.py`), any other name is refused, and the arrays are
taken out of the records afterwards (`pickled_arrays.py`). Neither chumpy, which cannot be installed on
current Pythons, nor scipy is needed.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from hand_recon.hand.mano import pickled_arrays
from hand_recon.hand.mano.inert_pickle import Record, RefusedPickleError, load_inert
from hand_recon.hand.mano.pickled_arrays import (
    BUFFER_NAMES,
    NUMPY_NAMES,
    Converter,
    NoNumbersError,
    Numbers,
)

MAX_BYTES: Final = 256 * 2**20
"""Size of the largest pickle that is read, bytes; MANO's has 4 MB."""

MAX_OPERATIONS: Final = 2**20
"""Largest number of instructions; MANO's has a few hundred, or 400,000 if all arrays are saved as lists."""

ALLOWED: Final[Mapping[tuple[str, str], str]] = {
    **NUMPY_NAMES,
    **BUFFER_NAMES,
    ("chumpy.ch", "Ch"): "Ch",
    ("chumpy.reordering", "Select"): "Select",
    # chumpy's bookkeeping.
    ("__builtin__", "set"): "set",
    ("builtins", "set"): "set",
    **{(f"scipy.sparse.{m}", "csc_matrix"): "csc_matrix" for m in ("csc", "_csc")},
    **{(f"scipy.sparse.{m}", "csr_matrix"): "csr_matrix" for m in ("csr", "_csr")},
}
"""The seven globals of MANO's files, and their names in newer versions of Python and scipy."""


def load_pickle(data: bytes, name: str) -> dict[str, object]:
    """Read the dictionary in a pickle, with records as values that `to_array` converts.

    Args:
        data: Content of the file.
        name: File name, for messages.

    Raises:
        RefusedPickleError: It names functions that MANO's files do not, is damaged, or holds no dictionary.
    """
    if len(data) > MAX_BYTES:
        raise RefusedPickleError(
            f"{name} has {len(data)} bytes, expected at most {MAX_BYTES}: not read. Is it MANO's?"
        )
    try:
        return load_inert(data, ALLOWED, MAX_OPERATIONS)
    except RefusedPickleError as error:
        raise RefusedPickleError(
            f"{name} {error} Check that the download is complete and from MANO's site."
        ) from error


def to_array(value: object) -> np.ndarray:
    """Convert a record to an array.

    Raises:
        NoNumbersError: The record holds no numbers, too many, or is inconsistent.
    """
    return pickled_arrays.to_array(value, _CONVERTERS)


def _state_of(record: Record) -> dict[str, object]:
    if not isinstance(record.state, dict):
        raise NoNumbersError(f"a {record.kind} without content")
    return record.state


def _chumpy(record: Record, numbers: Numbers) -> np.ndarray:
    """`chumpy.ch.Ch`: an array in its state's `x`."""
    return numbers.array(_state_of(record).get("x"))


def _whole(value: object, numbers: Numbers) -> np.ndarray:
    array = numbers.array(value)
    if array.dtype.kind not in "iu":
        raise NoNumbersError(f"a selection by indices of type {array.dtype}, expected integers")
    return array.astype(np.int64)


def _select(record: Record, numbers: Numbers) -> np.ndarray:
    """`chumpy.reordering.Select`: `ravel(a)[idxs]`, reshaped to `preferred_shape`."""
    state = _state_of(record)
    chosen = numbers.array(state.get("a")).ravel()[_whole(state.get("idxs"), numbers)]
    shape = state.get("preferred_shape")
    return chosen if shape is None else chosen.reshape(_whole(shape, numbers).tolist())


def _sparse(record: Record, numbers: Numbers) -> np.ndarray:
    """Convert a compressed sparse matrix to a dense array."""
    state = _state_of(record)
    shape = numbers.array(state.get("_shape", state.get("shape")))
    rows, columns = (int(size) for size in shape)
    by_rows = record.kind == "csr_matrix"
    lines, width = (rows, columns) if by_rows else (columns, rows)
    data = numbers.array(state.get("data"))
    indices, starts = (_whole(state.get(name), numbers) for name in ("indices", "indptr"))
    counts = np.diff(starts)
    whole = len(counts) == lines and counts.min() >= 0 and counts.sum() == len(data)
    if not whole or width < 0 or indices.min() < 0:
        raise NoNumbersError(f"a sparse matrix of {rows} × {columns} with inconsistent indices")
    numbers.spend(lines * width * 8)
    dense = np.zeros((lines, width))
    line = np.repeat(np.arange(lines), counts)
    np.add.at(dense, (line, indices), data)
    return dense if by_rows else dense.T


_CONVERTERS: Final[Mapping[str, Converter]] = {
    "Ch": _chumpy,
    "Select": _select,
    "csc_matrix": _sparse,
    "csr_matrix": _sparse,
}
