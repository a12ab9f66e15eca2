"""Frames that are decoded ahead of their use, in a thread."""

import queue
import threading
from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

Item = TypeVar("Item")

_FAREWELL = 5.0
"""Seconds that the thread gets to finish the frame at hand when it is no longer needed."""


class _End:
    """Last entry of the queue."""

    def __init__(self, error: BaseException | None) -> None:
        self.error = error


def ahead(items: Iterable[Item], size: int = 4) -> Generator[Item, None, None]:
    """Iterate with one thread that works ahead, for example decoding beside networks.

    At most `size` + 2 items are in memory: those that wait, the one that is being made, and the one in use.
    The thread begins with the first item, and ends with the last, with an error, or when the iterator is
    closed (`contextlib.closing`) or no longer referred to. It closes the iteration of `items` itself.

    Args:
        items: Frames, or what else is made one after the other.
        size: Most items that wait, at least 1.

    Raises:
        ValueError: `size` is below 1.
        Exception: Any error of the iteration, raised in its place among the items.
    """
    if size < 1:
        raise ValueError(
            f"size is {size}; expected the number of frames that may wait, at least 1."
        )
    return _handed_over(items, size)


def _handed_over(items: Iterable[Item], size: int) -> Generator[Item, None, None]:
    waiting: queue.Queue[Item | _End] = queue.Queue(size)
    closing = threading.Event()

    def put(entry: Item | _End) -> bool:
        while not closing.is_set():
            try:
                waiting.put(entry, timeout=0.1)
            except queue.Full:
                continue
            return True
        return False

    thread = threading.Thread(target=_make, args=(items, put), name="frames ahead", daemon=True)
    thread.start()
    try:
        while not isinstance(entry := waiting.get(), _End):
            yield entry
            # The array of a frame is given back before the next one is waited for.
            del entry
        if entry.error is not None:
            raise entry.error
    finally:
        closing.set()
        thread.join(_FAREWELL)


def _make(items: Iterable[Item], put: Callable[[Item | _End], bool]) -> None:
    error: BaseException | None = None
    iterator = iter(items)
    try:
        while put(next(iterator)):
            pass
    except StopIteration:
        pass
    except BaseException as raised:  # noqa: BLE001  # it is raised where the items are used
        error = raised
    finally:
        # The file is released by the thread that reads it.
        getattr(iterator, "close", lambda: None)()
        put(_End(error))
