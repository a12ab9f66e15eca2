"""Random numbers that are drawn on the processor, so that they are the same on every device."""

from torch import Tensor


def on_device_of(draws: Tensor, like: Tensor) -> Tensor:
    """Copy draws to the device and kind of numbers of another tensor.

    A GPU is not waited for: from pageable memory, the copy would begin when all work before it is done.

    Args:
        draws: Numbers on any device.
        like: Tensor on the device where they are used.
    """
    if like.is_cuda and not draws.is_cuda:
        return draws.pin_memory().to(like, non_blocking=True)
    return draws.to(like)
