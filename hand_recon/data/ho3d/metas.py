"""HO3D's `meta/*.pkl`: dictionaries of small arrays, read without running anything in them.

A pickle names functions and classes that its reader fetches and calls. Arrays need six; every one of them
stands here for a class of this module that does nothing but keep numbers, and any other name is refused.
The files were written by Python 2 (shreyashampali/ho3d): their strings are read as Latin-1.
"""

import io
import math
import pickle
import pickletools
import re
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

MAX_BYTES: Final = 16 * 2**20
"""Largest file that is read; HO3D's have some 50 kB."""

_CURE: Final = (
    "Unpack the archive again; if it stays, take the frame out of the list of ids in the .txt file."
)


class _Kept:
    """What a pickle makes of the names it may use: no state can be forced upon it."""

    def __init__(self, *arguments: object) -> None:
        self.arguments = arguments

    def __setstate__(self, state: object) -> None:
        raise TypeError(f"a {type(self).__name__.strip('_')} with a state")

    def numbers(self) -> np.ndarray | None:
        """As an array; none stands for an array of nothing but None."""
        raise TypeError(f"a {type(self).__name__.strip('_')} in the place of numbers")


class _Type(_Kept):
    """`numpy.ndarray`, which is only passed on."""


class _Bytes(_Kept):
    """What `_codecs.encode` makes: bytes that Python 3 writes for Python 2."""

    def raw(self) -> bytes:
        """The bytes."""
        text, encoding = self.arguments
        if encoding not in ("latin1", "latin-1"):
            raise TypeError(f"bytes in the encoding {encoding!r}")
        return str(text).encode("latin1")


class _DType(_Kept):
    """`numpy.dtype`."""

    order: Literal["=", "<", ">"] = "="

    def __setstate__(self, state: object) -> None:
        if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">"):
            self.order = "<" if state[1] == "<" else ">"

    def number(self) -> np.dtype:
        """The type, if it is one of numbers."""
        code = str(self.arguments[0]) if self.arguments else ""
        if not re.fullmatch(r"[<>|=]?[fiub][1248]", code):
            raise TypeError(f"an array of type {code!r}, which is no number")
        return np.dtype(code) if self.order == "=" else np.dtype(code).newbyteorder(self.order)


class _Array(_Kept):
    """What `numpy.core.multiarray._reconstruct` makes, empty until its state comes."""

    state: object = None

    def __setstate__(self, state: object) -> None:
        self.state = state

    def numbers(self) -> np.ndarray | None:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise TypeError("an array without content")
        _, shape, dtype, by_columns, raw = self.state
        if isinstance(raw, list) and all(entry is None for entry in raw):
            return None
        return _array(raw, dtype, shape, "F" if by_columns else "C")


class _Scalar(_Kept):
    """What `numpy.core.multiarray.scalar` makes."""

    def numbers(self) -> np.ndarray:
        dtype, raw = self.arguments
        return _array(raw, dtype, (), "C")


ALLOWED: Final[dict[tuple[str, str], type[_Kept]]] = {
    ("numpy", "dtype"): _DType,
    ("numpy", "ndarray"): _Type,
    ("_codecs", "encode"): _Bytes,
    **{(f"numpy.{core}.multiarray", "_reconstruct"): _Array for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): _Scalar for core in ("core", "_core")},
}
"""The names that arrays need, and what they are here."""


class RefusedMetaError(ValueError):
    """A meta file asks for what no array needs, is damaged, or lacks what it should hold."""


class _Unpickler(pickle.Unpickler):  # noqa: S301  # of classes that do nothing
    """Finds the classes of `ALLOWED` and nothing else."""

    def __init__(self, content: bytes, path: Path) -> None:
        super().__init__(io.BytesIO(content), encoding="latin1")
        self.path = path

    def find_class(self, module: str, name: str) -> type[_Kept]:
        if (module, name) not in ALLOWED:
            raise RefusedMetaError(
                f"{self.path} is refused: the pickle asks for {module}.{name}, which no annotation needs. "
                f"Nothing of it was run. Do not trust where it comes from. {_CURE}"
            )
        return ALLOWED[module, name]


class Meta:
    """One frame's annotation."""

    def __init__(self, path: Path, content: dict[str, object]) -> None:
        """Keep the content; `read_meta` reads it."""
        self.path = path
        self._content = content

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def numbers(self, key: str, shape: tuple[int, ...]) -> Float[np.ndarray, "..."] | None:
        """An entry as an array of that shape; none where the frame has no annotation.

        Raises:
            RefusedMetaError: There is no such entry, or it is something else.
        """
        if key not in self._content:
            raise RefusedMetaError(
                f"{self.path} has no {key}; it has {sorted(self._content)}. {_CURE}"
            )
        try:
            found = _numbers(self._content[key])
        except (TypeError, ValueError) as error:
            raise RefusedMetaError(f"{self.path}: {key} is {error}. {_CURE}") from error
        if found is None:
            return None
        if found.shape != shape and found.squeeze().shape != shape:
            raise RefusedMetaError(
                f"{self.path}: {key} has the shape {found.shape}, expected {shape}. Training and evaluation "
                "have annotations of their own: are they in the right folders?"
            )
        return found.reshape(shape).astype(np.float64)


def read_meta(path: Path) -> Meta:
    """Read one file.

    Raises:
        RefusedMetaError: It asks for more than arrays, is damaged, or holds no dictionary.
        FileNotFoundError: It is not there.
    """
    content = path.read_bytes()
    if len(content) > MAX_BYTES:
        raise RefusedMetaError(
            f"{path} has {len(content)} bytes, more than any annotation: not read. {_CURE}"
        )
    try:
        _scan(content, path)
        loaded = _Unpickler(content, path).load()
    except RefusedMetaError:
        raise
    except Exception as error:
        # Damaged bytes raise nearly any exception: what they have in common is that this is no pickle.
        raise RefusedMetaError(
            f"{path} cannot be read as a pickle ({type(error).__name__}: {error}). Nothing of it was run. "
            f"{_CURE}"
        ) from error
    if not isinstance(loaded, dict):
        raise RefusedMetaError(
            f"{path} holds a {type(loaded).__name__}, expected a dictionary. {_CURE}"
        )
    return Meta(path, {str(key): value for key, value in loaded.items()})


def _scan(content: bytes, path: Path) -> None:
    """Refuse opcodes that could pass by `find_class`, or ask for memory without end.

    Extension codes fetch what the process has registered, and may find it in a cache.
    """
    for opcode, argument, _ in pickletools.genops(content):
        outside = opcode.name in ("EXT1", "EXT2", "EXT4", "PERSID", "BINPERSID", "NEXT_BUFFER")
        endless = opcode.name in ("PUT", "LONG_BINPUT") and int(argument or 0) > len(content)
        if outside or endless:
            raise RefusedMetaError(
                f"{path} is refused: the pickle uses {opcode.name} {argument}, which no annotation needs. "
                f"Nothing of it was run. {_CURE}"
            )


def _numbers(value: object) -> np.ndarray | None:
    if value is None:
        return None
    if isinstance(value, _Kept):
        return value.numbers()
    if isinstance(value, int | float):
        return np.asarray(value)
    if isinstance(value, list | tuple):
        return np.array([_numbers(entry) for entry in value], dtype=np.float64)
    raise TypeError(f"a {type(value).__name__} in the place of numbers")


def _array(raw: object, dtype: object, shape: object, order: str) -> np.ndarray:
    """An array from its bytes, whose number must be right."""
    if not isinstance(dtype, _DType):
        raise TypeError("an array without a type")
    number = dtype.number()
    sizes = shape if isinstance(shape, tuple) else (None,)
    content = _raw(raw)
    fits = all(isinstance(size, int) and size >= 0 for size in sizes)
    if not fits or math.prod(sizes) * number.itemsize != len(content):
        raise TypeError(f"an array of shape {shape!r} in {len(content)} bytes")
    flat = np.frombuffer(content, number)
    return flat.reshape(sizes, order="F" if order == "F" else "C")


def _raw(value: object) -> bytes:
    """The bytes of an array, in any of the ways that Pythons have written them."""
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        return value.encode("latin1")
    if isinstance(value, _Bytes):
        return value.raw()
    raise TypeError(f"an array whose numbers are a {type(value).__name__}")
