"""Ways in which a file can be broken: its place, its bytes, and the values in it."""

import contextlib
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Literal

import numpy as np

Kind = Literal["json", "lines", "csv", "text", "yaml", "xml", "binary"]
"""Kind of a file's content."""

DEPTH: Final = 100_000
"""Levels of nesting, enough to end a process whose parser recurses in C."""

HUGE: Final = b"1" + 400 * b"0"
"""A whole number that no double can hold."""

_NUMBER: Final = re.compile(rb"(?<![\w.\"-])-?\d+\.\d+(?:e-?\d+)?")
_TEXTS: Final = ("json", "lines", "csv", "text", "yaml", "xml")


def missing(path: Path) -> None:
    """Remove the file."""
    path.unlink()


def folder(path: Path) -> None:
    """Put an empty folder in its place."""
    path.unlink()
    path.mkdir()


def loop(path: Path) -> None:
    """Put a symbolic link to itself in its place."""
    path.unlink()
    path.symlink_to(path.name)


PLACES: Final[dict[str, Callable[[Path], None]]] = {
    "missing": missing, "folder": folder, "loop": loop,
}  # fmt: skip
"""Functions that put something else in the file's place."""


@contextlib.contextmanager
def unreadable(path: Path) -> Iterator[None]:
    """Take away the right to read a file, in the block; root becomes another user for as long."""
    path.chmod(0)
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)
        path.chmod(0o644)


def empty(content: bytes, kind: Kind) -> bytes:
    """Nothing."""
    return b""


def cut_off(content: bytes, kind: Kind) -> bytes:
    """The beginning of the file, to the middle of a line or value."""
    half = content[: len(content) * 2 // 3]
    return half if kind == "binary" else half.rstrip(b"\r\n ,;]}>")


def noise(content: bytes, kind: Kind) -> bytes:
    """Random bytes."""
    return np.random.default_rng(3).bytes(2000)


def not_utf8(content: bytes, kind: Kind) -> bytes | None:
    """The file with bytes in a number that are no UTF-8."""
    return None if kind == "binary" else _instead_of_number(content, b"\xe9\xff")


def nested(content: bytes, kind: Kind) -> bytes | None:
    """Nothing but levels."""
    if kind in ("json", "yaml"):
        return DEPTH * b"[" + DEPTH * b"]"
    if kind == "lines":
        return DEPTH * b'{"a":' + DEPTH * b"}"
    # The outermost element stays, by which files of this kind are recognized.
    start = re.match(rb"\s*(<\?.*?\?>)?\s*<(\w+)[^>]*>", content, re.DOTALL)
    if kind != "xml" or start is None:
        return None
    return start[0] + DEPTH * b"<a>" + DEPTH * b"</a>" + b"</" + start[2] + b">"


def nested_and_cut_off(content: bytes, kind: Kind) -> bytes | None:
    """The beginning of nothing but levels."""
    whole = nested(content, kind)
    return None if whole is None else whole[: len(whole) // 3]


def huge(content: bytes, kind: Kind) -> bytes | None:
    """A whole number of 400 digits in the place of a number."""
    return None if kind == "binary" else _instead_of_number(content, HUGE)


def infinite(content: bytes, kind: Kind) -> bytes | None:
    """1e400, which no double can hold, in the place of a number."""
    return None if kind == "binary" else _instead_of_number(content, b"1e400")


def one_less(content: bytes, kind: Kind) -> bytes | None:
    """One number less than there should be."""
    if kind not in _TEXTS:
        return None
    changed, count = re.subn(rb"-?\d+\.\d+(?:e-?\d+)?\s*,\s*(?=-?\d)", b"", content, count=1)
    return changed if count else None


CONTENTS: Final[dict[str, Callable[[bytes, Kind], bytes | None]]] = {
    "empty": empty, "cut off": cut_off, "noise": noise, "no UTF-8": not_utf8, "nested": nested,
    "nested and cut off": nested_and_cut_off, "a huge number": huge, "1e400": infinite,
    "one number less": one_less,
}  # fmt: skip
"""Functions that make another content for the file; None where that makes no sense for the kind."""


def with_nan(content: bytes, kind: Kind) -> bytes | None:
    """NaN in the place of a number."""
    return None if kind == "binary" else _instead_of_number(content, b"NaN")


def _instead_of_number(content: bytes, text: bytes) -> bytes:
    """The content with a text in the place of its second number; the first may be a version or a score."""
    found = list(_NUMBER.finditer(content))
    match = found[1] if len(found) > 1 else found[0]
    return content[: match.start()] + text + content[match.end() :]
