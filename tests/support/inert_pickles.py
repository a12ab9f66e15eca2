"""Small pickles whose references expand to millions of values."""

import struct

import numpy as np

from tests.support.mano_file import Named, opcodes

DEPTH = 22
"""Levels of nested pairs: four million entries in a hundred bytes, few enough for a failing test to end."""

HASHED_DEPTH = 30
"""Levels of nested pairs used as a key: hashing visits a hundred times as many per second."""

HUGE = b"\x8b" + struct.pack("<i", 900) + 899 * b"\x01" + b"\x00"
"""A whole number of 7,200 bits, beyond any double."""


def laughs(leaf: bytes = b"K\x01", depth: int = DEPTH) -> bytes:
    """Nested pairs: each level holds the one below it twice."""
    levels = (b"q" + bytes([n]) + b"h" + bytes([n]) + b"\x86" for n in range(depth))
    return leaf + b"".join(levels)


def repeated(value: bytes, times: int) -> bytes:
    """A list that holds one value many times."""
    return b"](" + value + b"q\xfa" + (times - 1) * b"h\xfa" + b"e"


def entry(value: bytes, key: str = "a") -> bytes:
    """A pickled dictionary of one entry."""
    return b"\x80\x02}(" + opcodes(key) + value + b"u."


def dtype(code: bytes) -> bytes:
    """A call of `numpy.dtype` with any argument."""
    return b"cnumpy\ndtype\n" + code + b"\x85R"


def array(code: bytes, shape: bytes, raw: bytes) -> bytes:
    """An array whose type, shape and data are any pickled values."""
    made = b"cnumpy.core.multiarray\n_reconstruct\n)R"
    return made + b"(K\x01" + shape + dtype(code) + b"\x89" + raw + b"tb"


def cycle() -> bytes:
    """A list that contains itself."""
    return b"]q\x00h\x00a"


HOSTILE_VALUES: dict[str, bytes] = {
    "tuples of tuples": laughs(),
    "tuples of tuples of nothing": laughs(b")"),
    "one megabyte a thousand times": repeated(opcodes(np.zeros(131072)), 1000),
    "one list two thousand times, of one list two thousand times": repeated(
        b"](" + 2000 * b"K\x01" + b"e", 2000
    ),
    "a list in itself": cycle(),
    "tuples of tuples for a type": array(laughs(), b"K\x01\x85", b"U\x08" + bytes(8)),
    "tuples of tuples for a shape": array(b"U\x02f8", laughs(), b"U\x08" + bytes(8)),
    "tuples of tuples for numbers": array(b"U\x02f8", b"K\x01\x85", laughs()),
    "a shape of huge numbers": array(b"U\x02f8", HUGE + HUGE + b"\x86", b"U\x08" + bytes(8)),
    "a huge number": repeated(HUGE, 1),
    "a huge number beside a small one": b"](" + HUGE + b"G" + bytes(8) + b"e",
    "a huge number alone": HUGE,
    "five hundred lists in each other": 500 * b"]" + 499 * b"a",
    "a call without arguments": b"cnumpy.core.multiarray\nscalar\n)R",
    "a class made without its function": b"cnumpy.core.multiarray\n_reconstruct\n)\x81",
    "bytes in an endless encoding": array(
        b"U\x02f8", b"K\x01\x85", b"c_codecs\nencode\n" + b"U\x00" + laughs() + b"\x86R"
    ),
    "bytes that are endless": array(
        b"U\x02f8", b"K\x01\x85", b"c_codecs\nencode\n" + laughs() + b"U\x06latin1\x86R"
    ),
    "a list of nothing": b"](NNe",
}
"""Values that are no arrays of numbers, written with allowed names only."""

_KEY = laughs(depth=HASHED_DEPTH)

HOSTILE_PICKLES: dict[str, bytes] = {
    "a key": b"\x80\x02}" + _KEY + b"Ns.",
    "keys": b"\x80\x02}(" + _KEY + b"Nu.",
    "a key of protocol 0": b"(" + _KEY + b"N" + b"d.",
    "a key within": entry(b"}" + _KEY + b"Ns"),
    "a set within": b"\x80\x04}(" + opcodes("a") + b"}\x8f(" + _KEY + b"\x90\x91su.",
    "a number for a key": b"\x80\x02}K\x01Ns.",
}
"""Pickles that must be refused before they are loaded."""


def chumpy(value: bytes) -> bytes:
    """A `chumpy.ch.Ch` of a value."""
    empty = opcodes(Named("chumpy.ch Ch", {}))[:-4]
    return empty + b"}(" + opcodes("x") + value + b"ub"
