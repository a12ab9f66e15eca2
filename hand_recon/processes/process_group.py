"""Sums, means and messages between the processes that train together; alone, each value is its own sum.

Every function that exchanges something has to be called by all processes, in the same order.
"""

from datetime import timedelta
from typing import Any, Final, TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

Value = TypeVar("Value")

LONG: Final = timedelta(days=2)
"""Longest wait for a process that renders or decodes what the others will read."""


def rank() -> int:
    """Number of this process, from 0."""
    return dist.get_rank() if _together() else 0


def count() -> int:
    """Number of processes that train together."""
    return dist.get_world_size() if _together() else 1


def summed(values: Tensor) -> Tensor:
    """Sum over all processes, element by element.

    Args:
        values: This process's, without a gradient; of the same shape in all.
    """
    if not _together():
        return values
    total = values.clone()
    dist.all_reduce(total)
    return total


def averaged(values: Tensor) -> Tensor:
    """Mean over all processes, element by element; see `summed`."""
    return summed(values) / count()


def in_any_process(value: bool) -> bool:
    """True in all processes if it is true in one."""
    if not _together():
        return value
    # On the processor, so that no accelerator is waited for.
    flag = torch.tensor(int(value))
    dist.all_reduce(flag, op=dist.ReduceOp.MAX)
    return bool(flag)


def gathered(value: Value, *, patient: bool = False) -> list[Value]:
    """Values of all processes, by rank.

    Args:
        value: This process's; anything that can be pickled.
        patient: True waits for days: for processes that prepare data.
    """
    if not _together():
        return [value]
    values: list[Any] = [None] * count()
    if not patient:
        dist.all_gather_object(values, value)
        return values
    group: Any = dist.new_group(backend="gloo", timeout=LONG)
    dist.all_gather_object(values, value, group=group)
    dist.destroy_process_group(group)
    return values


def _together() -> bool:
    return dist.is_available() and dist.is_initialized()
