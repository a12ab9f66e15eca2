"""A cache's name differs for every difference in what it depends on."""

import tracemalloc

import numpy as np
import pytest

from hand_recon.data.cache import digest

PARTS: list[tuple[object, ...]] = [
    (),
    (None,),
    ("",),
    (b"",),
    (b"ab",),
    (b"a", b"b"),
    (b"", b"ab"),
    ("ab",),
    ("b'ab'",),
    (("a", "b"),),
    ("a", "b"),
    (1,),
    (1.0,),
    (np.zeros(2, np.uint8),),
    (b"\0\0",),
    (np.zeros(2, np.int8),),
    (np.zeros((1, 2), np.uint8),),
    (np.zeros((2, 1), np.uint8),),
    (np.zeros(1, np.uint8), np.zeros(1, np.uint8)),
    (np.zeros(0),),
    (np.zeros((0, 3)),),
    (np.zeros(4, np.float32),),
    (np.zeros(2, np.float64),),
    (np.array(0.0),),
    (np.array([0.0, 1.0]),),
    (np.array([1.0, 0.0]),),
    # A part that looks like another one's header.
    (b"bytes 2\nab",),
]


def test_different_parts_have_different_names() -> None:
    names = [digest(*parts) for parts in PARTS]
    assert len(set(names)) == len(PARTS)
    assert names == [digest(*parts) for parts in PARTS]


def test_the_middle_of_a_long_array_counts_and_its_place_in_memory_does_not() -> None:
    array = np.arange(10_000.0).reshape(100, 100)
    changed = array.copy()
    changed[50, 50] += 1e-9
    assert digest(array) != digest(changed)
    assert digest(array) == digest(np.asfortranarray(array)) == digest(array[::-1][::-1])


def test_large_buffers_are_not_copied() -> None:
    parts = (np.zeros(4_000_000), bytes(32_000_000))
    tracemalloc.start()
    digest(*parts)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000


def test_arrays_of_objects_are_refused() -> None:
    with pytest.raises(TypeError, match="array of objects"):
        digest(np.array([None, "a"], dtype=object))
