"""Conversion of a pickle's inert records (`inert_pickle.py`) to arrays, within a memory budget.

A pickle of a few hundred bytes can repeat one list or array a thousand million times. Every array is
therefore counted against a budget of bytes per value before it is made.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from hand_recon.hand.mano.inert_pickle import Record

BUDGET: Final = 16 * 2**20
"""Budget of one value, bytes; the largest of MANO's takes 2.5 MB, or 10 MB as nested lists."""

DEEPEST: Final = 8
"""Largest nesting depth of lists and records; MANO's need five."""

_NUMBER_COST: Final = 32
_ENTRY_COST: Final = 256
"""Bytes charged for a number in a list, and for a list or record, which bound the time as well."""

NUMPY_NAMES: Final[Mapping[tuple[str, str], str]] = {
    ("numpy", "dtype"): "dtype",
    ("numpy", "ndarray"): "type",
    ("_codecs", "encode"): "bytes",
    **{(f"numpy.{core}.multiarray", "_reconstruct"): "array" for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): "scalar" for core in ("core", "_core")},
}
"""Globals that arrays need up to protocol 4, in old and new versions of NumPy."""

BUFFER_NAMES: Final[Mapping[tuple[str, str], str]] = {
    (f"numpy.{core}.numeric", "_frombuffer"): "buffer" for core in ("core", "_core")
}
"""Globals that arrays need in protocol 5."""

Converter = Callable[[Record, "Numbers"], np.ndarray]
"""Function that converts one kind of record to an array."""


class NoNumbersError(ValueError):
    """Value without numbers, with too many, or inconsistent; the message names it."""


class Numbers:
    """Converter of one value to an array, with the budget that is left."""

    def __init__(self, converters: Mapping[str, Converter]) -> None:
        """Start with the full budget.

        Args:
            converters: Converters for kinds of records other than NumPy's.
        """
        self._converters = {"array": _array, "buffer": _buffer, "scalar": _scalar, **converters}
        self._left = BUDGET
        self._depth = 0

    def spend(self, size: int) -> None:
        """Charge a number of bytes to the budget.

        Raises:
            NoNumbersError: The budget is exhausted.
        """
        self._left -= size
        if self._left < 0:
            raise NoNumbersError(
                f"a value of more than {BUDGET >> 20} MiB of numbers, counting repeated ones"
            )

    def array(self, value: object) -> np.ndarray:
        """Convert a record, list or number to an array.

        Raises:
            ValueError: There are no numbers (`NoNumbersError`), or NumPy cannot make an array of them.
        """
        array = np.asarray(self._entry(value))
        if array.dtype.kind not in "biuf":
            raise NoNumbersError("an integer that does not fit 64 bits")
        return array

    def _entry(self, value: object) -> object:
        """Convert a value to a number, an array, or a list of them."""
        self.spend(_ENTRY_COST)
        if isinstance(value, bool | int | float):
            return value
        if self._depth == DEEPEST:
            raise NoNumbersError(f"a value of more than {DEEPEST} nested lists or records")
        self._depth += 1
        try:
            return self._inner(value)
        finally:
            self._depth -= 1

    def _inner(self, value: object) -> object:
        if isinstance(value, Record) and value.kind in self._converters:
            return self._converters[value.kind](value, self)
        if isinstance(value, list | tuple):
            self.spend(_NUMBER_COST * len(value))
            return [
                entry if isinstance(entry, int | float) else self._entry(entry) for entry in value
            ]
        name = value.kind if isinstance(value, Record) else type(value).__name__
        raise NoNumbersError(f"a {name} holds no numbers")


def to_array(value: object, converters: Mapping[str, Converter] | None = None) -> np.ndarray:
    """Convert a value that `load_inert` has read to an array.

    Args:
        value: A record, a number, or nested lists of them.
        converters: Converters for kinds of records other than NumPy's.

    Raises:
        NoNumbersError: The value holds no numbers, too many, or is inconsistent.
    """
    try:
        return Numbers(converters or {}).array(value)
    except NoNumbersError:
        raise
    except (TypeError, ValueError, IndexError, ArithmeticError, MemoryError) as error:
        # NumPy reports inconsistent records by many kinds of exceptions.
        raise NoNumbersError(
            f"an inconsistent value ({type(error).__name__}: {str(error)[:200]})"
        ) from error


def is_nothing(value: object) -> bool:
    """True for None and for an object array whose entries are all None."""
    if not isinstance(value, Record) or value.kind != "array":
        return value is None
    raw = value.state[4] if isinstance(value.state, tuple) and len(value.state) == 5 else None
    return isinstance(raw, list) and all(entry is None for entry in raw)


def _dtype(record: object) -> np.dtype:
    if not isinstance(record, Record) or record.kind != "dtype" or not record.arguments:
        raise NoNumbersError("an array without a dtype")
    code = record.arguments[0]
    if not isinstance(code, str) or not re.fullmatch(r"[<>|=]?[fiub][1248]", code):
        # Only text is shown: the text of a nested tuple could be endless.
        shown = repr(code[:20]) if isinstance(code, str) else f"a {type(code).__name__}"
        raise NoNumbersError(f"an array of dtype {shown}, which is not numeric")
    dtype, state = np.dtype(code), record.state
    if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">"):
        dtype = dtype.newbyteorder("<" if state[1] == "<" else ">")
    return dtype


def _raw(value: object, numbers: Numbers) -> bytes:
    """Bytes of an array, in any of the forms that versions of Python write."""
    if isinstance(value, Record) and value.kind == "bytes":
        # Python 3 writes bytes for Python 2 as a call of `_codecs.encode`.
        if value.arguments[1:] not in (("latin1",), ("latin-1",)):
            raise NoNumbersError("an array of bytes in an encoding other than Latin-1")
        value = value.arguments[0]
    if not isinstance(value, bytes | bytearray | str):
        raise NoNumbersError(f"an array with a {type(value).__name__} for its bytes")
    numbers.spend(len(value))
    return value.encode("latin1") if isinstance(value, str) else bytes(value)


def _from_bytes(
    raw: object, dtype: object, shape: object, order: str, numbers: Numbers
) -> np.ndarray:
    """Array from its bytes, whose number must match the shape."""
    number = _dtype(dtype)
    sizes = shape if isinstance(shape, tuple) else (shape,)
    if len(sizes) > DEEPEST or not all(isinstance(n, int) and 0 <= n < 2**31 for n in sizes):
        raise NoNumbersError("an array of an invalid shape")
    content = _raw(raw, numbers)
    if math.prod(sizes) * number.itemsize != len(content):
        raise NoNumbersError(f"an array of shape {sizes} in {len(content)} bytes")
    flat = np.frombuffer(content, number).astype(number.newbyteorder("="))
    return flat.reshape(sizes, order="F" if order == "F" else "C")


def _array(record: Record, numbers: Numbers) -> np.ndarray:
    """Array of a record of `numpy.core.multiarray._reconstruct`, whose content is in its state."""
    state = record.state
    if not isinstance(state, tuple) or len(state) != 5:
        raise NoNumbersError("an array without content")
    _, shape, dtype, by_columns, raw = state
    return _from_bytes(raw, dtype, shape, "F" if by_columns else "C", numbers)


def _buffer(record: Record, numbers: Numbers) -> np.ndarray:
    """Array of a record of `numpy.core.numeric._frombuffer`."""
    raw, dtype, shape, order = record.arguments
    return _from_bytes(raw, dtype, shape, "F" if order == "F" else "C", numbers)


def _scalar(record: Record, numbers: Numbers) -> np.ndarray:
    """Array of a record of `numpy.core.multiarray.scalar`."""
    dtype, raw = record.arguments
    return _from_bytes(raw, dtype, (), "C", numbers)
