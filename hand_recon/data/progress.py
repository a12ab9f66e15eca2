"""Progress display: a bar on a terminal, log lines elsewhere."""

import logging
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import track

logger = logging.getLogger(__name__)

Item = TypeVar("Item")

SECONDS_BETWEEN_LINES = 10.0
"""Time between log lines of a long task, seconds."""


def with_progress(items: Iterable[Item], total: int | None, task: str) -> Iterator[Item]:
    """Yield items and report progress.

    Args:
        items: Items to yield.
        total: Number of items; None if it is not known.
        task: Name of the task, for the display.
    """
    if Console(stderr=True).is_terminal:
        yield from track(items, task, total=total, console=Console(stderr=True), transient=True)
        return
    start = spoken = time.monotonic()
    for done, item in enumerate(items, start=1):
        yield item
        now = time.monotonic()
        if now - spoken > SECONDS_BETWEEN_LINES:
            spoken = now
            rate = done / (now - start)
            if total is None:
                logger.info("%s: %d, %.3g per second", task, done, rate)
                continue
            left = max(total - done, 0) / rate
            logger.info(
                "%s: %d of %d, %.3g per second, %.0f s to go", task, done, total, rate, left
            )
