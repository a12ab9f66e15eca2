"""Arrays out of a pickle's inert records (`inert_pickle.py`), within a budget.

A pickle of a few hundred bytes can name the same list or array a thousand million times. What is taken out is
therefore paid for before it is made: a value has so many bytes of numbers in all, or is refused.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from hand_recon.hand.mano.inert_pickle import Record

BUDGET: Final = 16 * 2**20
"""Bytes that one value may take; the largest of MANO's takes 2.5 MB, or 10 as lists of lists."""

DEEPEST: Final = 8
"""Lists and records in each other; MANO's need five."""

_NUMBER_COST: Final = 32
_ENTRY_COST: Final = 256
"""Bytes that stand for the time of a number in a list, and of a list or record."""

NUMPY_NAMES: Final[Mapping[tuple[str, str], str]] = {
    ("numpy", "dtype"): "dtype",
    ("numpy", "ndarray"): "type",
    ("_codecs", "encode"): "bytes",
    **{(f"numpy.{core}.multiarray", "_reconstruct"): "array" for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): "scalar" for core in ("core", "_core")},
}
"""The names that arrays need up to protocol 4, old and new."""

BUFFER_NAMES: Final[Mapping[tuple[str, str], str]] = {
    (f"numpy.{core}.numeric", "_frombuffer"): "buffer" for core in ("core", "_core")
}
"""What arrays need in protocol 5."""

Converter = Callable[[Record, "Numbers"], np.ndarray]
"""Makes an array of a record of some kind."""


class NoNumbersError(ValueError):
    """A value that holds no numbers, too many, or contradicts itself; the message says what it is."""


class Numbers:
    """Takes the numbers out of one value."""

    def __init__(self, converters: Mapping[str, Converter]) -> None:
        """Start with the whole budget.

        Args:
            converters: How kinds of records beside NumPy's become arrays.
        """
        self._converters = {"array": _array, "buffer": _buffer, "scalar": _scalar, **converters}
        self._left = BUDGET
        self._depth = 0

    def spend(self, size: int) -> None:
        """Pay for so many bytes.

        Raises:
            NoNumbersError: The budget does not suffice.
        """
        self._left -= size
        if self._left < 0:
            raise NoNumbersError(
                f"a value of more than {BUDGET >> 20} MiB of numbers, repeated ones included"
            )

    def array(self, value: object) -> np.ndarray:
        """The numbers of a record, list or number.

        Raises:
            ValueError: There are none (as `to_array` says it), or NumPy's own reason.
        """
        array = np.asarray(self._entry(value))
        if array.dtype.kind not in "biuf":
            raise NoNumbersError("a whole number that is too large")
        return array

    def _entry(self, value: object) -> object:
        """A number, an array, or a list of such."""
        self.spend(_ENTRY_COST)
        if isinstance(value, bool | int | float):
            return value
        if self._depth == DEEPEST:
            raise NoNumbersError(f"a value of more than {DEEPEST} lists or records in each other")
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
    """The numbers of a value that `load_inert` has read.

    Args:
        value: A record, a number, or lists of them in each other.
        converters: How kinds of records beside NumPy's become arrays.

    Raises:
        NoNumbersError: It is none that holds numbers, holds too many, or contradicts itself.
    """
    try:
        return Numbers(converters or {}).array(value)
    except NoNumbersError:
        raise
    except (TypeError, ValueError, IndexError, ArithmeticError, MemoryError) as error:
        # What contradicts itself is found by NumPy in many ways.
        raise NoNumbersError(
            f"an odd value ({type(error).__name__}: {str(error)[:200]})"
        ) from error


def is_nothing(value: object) -> bool:
    """Whether it is None, or an array of nothing but None."""
    if not isinstance(value, Record) or value.kind != "array":
        return value is None
    raw = value.state[4] if isinstance(value.state, tuple) and len(value.state) == 5 else None
    return isinstance(raw, list) and all(entry is None for entry in raw)


def _dtype(record: object) -> np.dtype:
    if not isinstance(record, Record) or record.kind != "dtype" or not record.arguments:
        raise NoNumbersError("an array without a type")
    code = record.arguments[0]
    if not isinstance(code, str) or not re.fullmatch(r"[<>|=]?[fiub][1248]", code):
        # Only text is shown: a tuple of tuples could be without end.
        shown = repr(code[:20]) if isinstance(code, str) else f"a {type(code).__name__}"
        raise NoNumbersError(f"an array of type {shown}, which is no number")
    dtype, state = np.dtype(code), record.state
    if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">"):
        dtype = dtype.newbyteorder("<" if state[1] == "<" else ">")
    return dtype


def _raw(value: object, numbers: Numbers) -> bytes:
    """The bytes of an array, in any of the ways that Pythons have written them."""
    if isinstance(value, Record) and value.kind == "bytes":
        # What `_codecs.encode` makes: bytes that Python 3 writes for Python 2.
        if value.arguments[1:] not in (("latin1",), ("latin-1",)):
            raise NoNumbersError("an array of bytes in another encoding than Latin-1")
        value = value.arguments[0]
    if not isinstance(value, bytes | bytearray | str):
        raise NoNumbersError(f"an array whose numbers are a {type(value).__name__}")
    numbers.spend(len(value))
    return value.encode("latin1") if isinstance(value, str) else bytes(value)


def _from_bytes(
    raw: object, dtype: object, shape: object, order: str, numbers: Numbers
) -> np.ndarray:
    """An array from its bytes, whose number must be right."""
    number = _dtype(dtype)
    sizes = shape if isinstance(shape, tuple) else (shape,)
    if len(sizes) > DEEPEST or not all(isinstance(n, int) and 0 <= n < 2**31 for n in sizes):
        raise NoNumbersError("an array of a shape that is none")
    content = _raw(raw, numbers)
    if math.prod(sizes) * number.itemsize != len(content):
        raise NoNumbersError(f"an array of shape {sizes} in {len(content)} bytes")
    flat = np.frombuffer(content, number).astype(number.newbyteorder("="))
    return flat.reshape(sizes, order="F" if order == "F" else "C")


def _array(record: Record, numbers: Numbers) -> np.ndarray:
    """What `numpy.core.multiarray._reconstruct` makes, empty until its state comes."""
    state = record.state
    if not isinstance(state, tuple) or len(state) != 5:
        raise NoNumbersError("an array without content")
    _, shape, dtype, by_columns, raw = state
    return _from_bytes(raw, dtype, shape, "F" if by_columns else "C", numbers)


def _buffer(record: Record, numbers: Numbers) -> np.ndarray:
    """What `numpy.core.numeric._frombuffer` makes."""
    raw, dtype, shape, order = record.arguments
    return _from_bytes(raw, dtype, shape, "F" if order == "F" else "C", numbers)


def _scalar(record: Record, numbers: Numbers) -> np.ndarray:
    """What `numpy.core.multiarray.scalar` makes."""
    dtype, raw = record.arguments
    return _from_bytes(raw, dtype, (), "C", numbers)
