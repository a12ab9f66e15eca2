"""Errors as values: what fails together is run alone, so that one row never takes others with it."""

import logging
from collections.abc import Callable, Sequence
from typing import TypeVar

from hand_recon.detection.models import ModelsError

logger = logging.getLogger(__name__)

Item = TypeVar("Item")
Row = TypeVar("Row")

NOT_OF_A_ROW = (ModuleNotFoundError, ModelsError)
"""Errors of the installation: raised, since every other row would have them, too."""


def rows_or_errors(
    items: Sequence[Item],
    run: Callable[[Sequence[Item]], list[Row]],
    failed: Callable[[Item, str], Row],
) -> list[Row]:
    """Run a function over all items at once and, where it fails, over halves of them, down to single ones.

    Args:
        items: The items.
        run: Function that makes a row of each.
        failed: Function that makes the row of an item that fails alone, from the reason.

    Raises:
        ModuleNotFoundError: A package is not installed.
        ModelsError: The detector's models cannot be had.
    """
    if not items:
        return []
    try:
        return run(items)
    except NOT_OF_A_ROW:
        raise
    except Exception as error:  # noqa: BLE001  # decoders and networks can raise anything
        if len(items) == 1:
            return [failed(items[0], reason_of(error))]
        middle = len(items) // 2
        halves = (items[:middle], items[middle:])
        return [row for half in halves for row in rows_or_errors(half, run, failed)]


def reason_of(error: BaseException) -> str:
    """Reason of a failure as text: the message of our own errors, and the kind of error of others'.

    Args:
        error: The error.
    """
    text = str(error).strip()
    if isinstance(error, ValueError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
