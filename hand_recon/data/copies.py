"""Copies to a device for which a GPU is not waited."""

import torch
from torch import Tensor


def copied(values: Tensor, device: torch.device, dtype: torch.dtype | None = None) -> Tensor:
    """Copy values to a device; from pageable memory, a GPU would be waited for until all work before is done.

    Args:
        values: Values on any device.
        device: Device where they are used.
        dtype: Kind of numbers; None for their own.
    """
    if device.type == "cuda" and not values.is_cuda:
        return values.pin_memory().to(device, dtype, non_blocking=True)
    return values.to(device, dtype)


def on_device_of(draws: Tensor, like: Tensor) -> Tensor:
    """Random numbers, drawn on the processor to be equal everywhere, on a tensor's device and dtype."""
    return copied(draws, like.device, like.dtype)
