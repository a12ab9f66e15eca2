"""Depthwise convolutions whose gradient is fast under mixed precision on processors (decision 101)."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional


def convolve(
    images: Tensor,
    weight: Tensor,
    bias: Tensor | None,
    stride: Sequence[int],
    padding: Sequence[int],
    *,
    groups: int,
) -> Tensor:
    """A convolution in two dimensions; in single precision where bfloat16 would have a slow gradient.

    oneDNN computes the gradient of a depthwise convolution in bfloat16 three to twenty times as slowly as
    in single precision, and everything else of a network for images about twice as fast.

    Args:
        images: (batch, channel, row, column).
        weight: (out, channel / groups, row, column).
        bias: (out,), or none.
        stride: Of rows and columns.
        padding: Zeros on either side of rows and columns.
        groups: Groups of channels that are convolved apart.

    Returns:
        (batch, out, row, column), in the precision of autocast where that is on.
    """
    slow = groups > 1 and weight.requires_grad and torch.is_grad_enabled()
    if not (slow and images.device.type == "cpu" and torch.is_autocast_enabled("cpu")):
        return functional.conv2d(images, weight, bias, stride, padding, groups=groups)
    with torch.autocast("cpu", enabled=False):
        features = functional.conv2d(images.float(), weight, bias, stride, padding, groups=groups)
    # What follows, batch normalization for one, is twice as fast in bfloat16.
    return features.to(torch.get_autocast_dtype("cpu"))


class DepthwiseConv2d(nn.Conv2d):
    """A convolution of every channel for itself, without a bias, of the same size as its input.

    Args:
        channels: Number of channels.
        kernel: Side of the kernel, odd.
    """

    def __init__(self, channels: int, kernel: int) -> None:
        super().__init__(
            channels, channels, kernel, padding=kernel // 2, groups=channels, bias=False
        )

    def forward(self, input: Tensor) -> Tensor:
        """Features of the same shape: (batch, channel, row, column)."""
        padding = [self.kernel_size[0] // 2, self.kernel_size[1] // 2]
        return convolve(input, self.weight, None, self.stride, padding, groups=self.groups)
