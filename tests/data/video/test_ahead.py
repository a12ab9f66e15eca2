"""Frames are made ahead in a thread: same items, errors in their place, bounded, and closed at once."""

import gc
import threading
import weakref
from collections.abc import Iterator
from contextlib import closing
from itertools import count, islice

import numpy as np
import pytest

from hand_recon.data.video.ahead import ahead
from hand_recon.data.video.frames import VideoError


def running() -> int:
    return sum(thread.name == "frames ahead" for thread in threading.enumerate())


@pytest.mark.parametrize("size", [1, 3, 100])
def test_items_come_in_order_each_once(size: int) -> None:
    assert list(ahead(range(50), size)) == list(range(50))
    assert list(ahead([], size)) == []
    assert running() == 0


def test_an_error_is_raised_after_the_items_before_it() -> None:
    def broken() -> Iterator[int]:
        yield 1
        yield 2
        raise VideoError("cut off")

    items = ahead(broken())
    assert [next(items), next(items)] == [1, 2]
    with pytest.raises(VideoError, match="cut off"):
        next(items)
    assert running() == 0


def test_it_works_ahead_but_no_further_than_the_queue() -> None:
    made = 0
    enough, too_many = threading.Event(), threading.Event()

    def frames() -> Iterator[int]:
        nonlocal made
        for made in count(1):
            if made == 5:
                enough.set()
            if made == 6:
                too_many.set()
            yield made

    with closing(ahead(frames(), size=3)) as items:
        assert next(items) == 1
        # One is in use, three wait, one is made already.
        assert enough.wait(5)
        assert not too_many.wait(0.05)
        assert list(islice(items, 3)) == [2, 3, 4]
        assert too_many.wait(5)
    assert running() == 0


def test_closing_early_ends_the_thread_and_closes_the_source_in_it() -> None:
    closed_by: list[str] = []

    def frames() -> Iterator[int]:
        try:
            yield from count()
        finally:
            closed_by.append(threading.current_thread().name)

    items = ahead(frames(), size=2)
    next(items)
    items.close()
    assert closed_by == ["frames ahead"]
    assert running() == 0


def test_an_iterator_that_is_forgotten_ends_its_thread() -> None:
    items = ahead(count(), size=2)
    next(items)
    del items
    gc.collect()
    assert running() == 0


def test_one_that_is_never_begun_starts_nothing() -> None:
    items = ahead(count())
    assert running() == 0
    del items


def test_items_that_were_used_are_freed() -> None:
    alive: list[weakref.ref[np.ndarray]] = []

    def frames() -> Iterator[np.ndarray]:
        for _ in range(60):
            image = np.zeros((4, 4, 3), np.uint8)
            alive.append(weakref.ref(image))
            yield image

    most = 0
    for _ in ahead(frames(), size=4):
        most = max(most, sum(reference() is not None for reference in alive))
    # Four wait, one is in the generator and one in use, and the loop holds the last one until the next comes.
    assert most <= 7


def test_a_queue_without_room_is_refused() -> None:
    with pytest.raises(ValueError, match="size is 0; expected"):
        ahead([], 0)
