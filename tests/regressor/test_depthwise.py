"""Depthwise convolutions: values and gradients of torch's own, and what runs in which precision."""

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from hand_recon.regressor.depthwise import DepthwiseConv2d, convolve
from tests.support.tolerance import assert_close
from tests.support.watched import GradientPrecisions


def _images(*shape: int) -> Tensor:
    images = torch.randn(*shape).contiguous(memory_format=torch.channels_last)
    return images.requires_grad_()


@pytest.mark.parametrize(
    ("kernel", "stride", "padding"), [(3, (1, 1), (1, 1)), (5, (2, 2), (2, 2)), (5, (2, 1), (0, 2))]
)
def test_it_is_torchs_convolution_with_the_same_gradients(
    kernel: int, stride: tuple[int, int], padding: tuple[int, int]
) -> None:
    images, weight = _images(2, 6, 9, 8), torch.randn(6, 1, kernel, kernel, requires_grad=True)
    own = convolve(images, weight, None, stride, padding, groups=6)
    theirs = functional.conv2d(images, weight, None, stride, padding, groups=6)
    assert torch.equal(own, theirs)
    towards = torch.randn_like(own)
    for mine, other in zip(
        torch.autograd.grad(own, (images, weight), towards),
        torch.autograd.grad(theirs, (images, weight), towards),
        strict=True,
    ):
        assert torch.equal(mine, other)


def test_the_module_reads_the_weights_of_torchs_and_gives_the_same() -> None:
    theirs = nn.Conv2d(4, 4, 5, padding=2, groups=4, bias=False)
    own = DepthwiseConv2d(4, 5)
    own.load_state_dict(theirs.state_dict())
    images = _images(2, 4, 7, 6)
    assert torch.equal(own(images), theirs(images))


def test_mixed_precision_leaves_depthwise_gradients_in_single_precision_and_no_others() -> None:
    images = _images(2, 8, 6, 6)
    depthwise = torch.randn(8, 1, 3, 3, requires_grad=True)
    pointwise = torch.randn(4, 8, 1, 1, requires_grad=True)
    with GradientPrecisions() as gradients:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            middle = convolve(images, depthwise, None, (1, 1), (1, 1), groups=8)
            features = convolve(middle, pointwise, None, (1, 1), (0, 0), groups=1)
        features.float().sum().backward()
    assert middle.dtype == features.dtype == torch.bfloat16
    assert sorted(gradients.seen, key=str) == [(1, torch.bfloat16), (8, torch.float32)]


def test_under_mixed_precision_values_are_single_ones_rounded_once() -> None:
    images, weight = _images(2, 8, 6, 6), torch.randn(8, 1, 5, 5, requires_grad=True)
    exact = convolve(images, weight, None, (1, 1), (2, 2), groups=8)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = convolve(images, weight, None, (1, 1), (2, 2), groups=8)
    assert torch.equal(rounded, exact.to(torch.bfloat16))
    towards = torch.randn_like(exact).to(torch.bfloat16)
    mine = torch.autograd.grad(rounded, weight, towards)[0]
    assert_close(mine, torch.autograd.grad(exact, weight, towards.float())[0])


@pytest.mark.parametrize("frozen", [True, False])
def test_without_gradients_all_is_in_bfloat16(*, frozen: bool) -> None:
    images, weight = _images(1, 4, 6, 6), torch.randn(4, 1, 3, 3, requires_grad=not frozen)
    with torch.autocast("cpu", dtype=torch.bfloat16), torch.set_grad_enabled(frozen):
        own = convolve(images, weight, None, (1, 1), (1, 1), groups=4)
        theirs = functional.conv2d(images, weight, None, 1, 1, groups=4)
    assert own.dtype == torch.bfloat16
    assert torch.equal(own, theirs)
