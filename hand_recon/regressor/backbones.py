"""Backbones by name, with weights: EfficientNet-Lite0, torchvision's and timm's (Sec. 4.1)."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.error import URLError

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.reading.archives import refuse_packed
from hand_recon.reading.naming import naming
from hand_recon.regressor.efficientnet_lite import (
    MEAN,
    STANDARD_DEVIATION,
    efficientnet_lite0,
    imagenet_weights,
    renamed,
)

EFFICIENTNET_LITE0: Final = "efficientnet_lite0"
"""The backbone for processors; its ImageNet weights are a package."""

TORCHVISION: Final = (
    "resnet18",
    "resnet34",
    "resnet50",
    "mobilenet_v3_small",
    "mobilenet_v3_large",
)
"""Backbones by torchvision's names; the paper's is ResNet-50."""

STRIDES: Final = (8, 16, 32)
"""Strides whose features a backbone gives."""

TIMM: Final = "timm/"
"""Prefix of the names of timm's networks."""

Normalization = tuple[Sequence[float], Sequence[float]]
"""Mean and standard deviation of red, green and blue, 0–1."""

Features = dict[int, Float[Tensor, "batch channel row column"]]
"""Features by stride."""

IMAGENET: Final = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Normalization of torchvision's and timm's weights."""

_PROBE: Final = 128
"""Side of the image that is sent through a backbone to find the strides of its layers, pixels."""


class Backbone(nn.Module, ABC):
    """A network from images to features at strides 8, 16 and 32."""

    mean: Tensor
    standard_deviation: Tensor
    channels: dict[int, int]
    """Channels of the features by stride."""

    def __init__(self, mean: Sequence[float], standard_deviation: Sequence[float]) -> None:
        super().__init__()
        for name, values in (("mean", mean), ("standard_deviation", standard_deviation)):
            self.register_buffer(name, torch.tensor(values)[:, None, None], persistent=False)

    def forward(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        """Features by stride.

        Args:
            images: RGB, 0–1.
        """
        normalized = (images - self.mean) / self.standard_deviation
        # Convolutions are fastest with channels last, on CPUs by a third.
        return self.pyramid(normalized.contiguous(memory_format=torch.channels_last))

    @abstractmethod
    def pyramid(self, images: Tensor) -> Features:
        """Features by stride of normalized images."""


class LayeredBackbone(Backbone):
    """A backbone whose layers follow one another; features at a stride are those of its last layer there.

    Args:
        layers: The layers.
        normalization: Mean and standard deviation of the images that the weights expect.
        frozen: Number of leading layers that keep their weights and statistics in training.

    Raises:
        ValueError: More layers are to be frozen than there are.
    """

    def __init__(
        self, layers: nn.Sequential, normalization: Normalization, frozen: int = 0
    ) -> None:
        super().__init__(*normalization)
        if not 0 <= frozen <= len(layers):
            raise ValueError(
                f"model.encoder.frozen={frozen}, and this backbone has {len(layers)} layers; expected a "
                "number from 0 to that."
            )
        self.layers = layers.to(memory_format=torch.channels_last)
        self.frozen = frozen
        self.taps, self.channels = _taps(layers)
        layers[:frozen].requires_grad_(requires_grad=False).eval()

    def train(self, mode: bool = True) -> "LayeredBackbone":
        """Set the mode of all layers but the frozen ones, which stay in evaluation."""
        super().train(mode)
        self.layers[: self.frozen].eval()
        return self

    def pyramid(self, images: Tensor) -> Features:
        """Features by stride of normalized images."""
        found = {}
        for index, layer in enumerate(self.layers):
            images = layer(images)
            if index in self.taps:
                found[self.taps[index]] = images
        return found


class TimmBackbone(Backbone):
    """One of timm's networks, by its own pyramid of features.

    Args:
        name: timm's name of the network.
        weights: `imagenet`, `none`, or the path of a state dict.

    Raises:
        ModuleNotFoundError: timm is not installed.
        ValueError: The network has no features at one of the strides.
    """

    def __init__(self, name: str, weights: str) -> None:
        super().__init__(*IMAGENET)
        try:
            import timm
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"model.encoder.backbone=timm/{name} needs the package timm, which is not installed: "
                "pip install timm."
            ) from error
        self.network = timm.create_model(name, pretrained=weights == "imagenet", features_only=True)
        if weights not in ("imagenet", "none"):
            self.network.load_state_dict(_read(name, weights))
        info = self.network.feature_info
        by_stride = dict(zip(info.reduction(), range(len(info)), strict=True))
        if any(stride not in by_stride for stride in STRIDES):
            raise ValueError(
                f"timm's {name} has features at the strides {sorted(by_stride)}; expected {list(STRIDES)} "
                "among them. Choose a convolutional network."
            )
        self.positions = {stride: by_stride[stride] for stride in STRIDES}
        self.channels = {stride: info.channels()[by_stride[stride]] for stride in STRIDES}

    def pyramid(self, images: Tensor) -> Features:
        """Features by stride of normalized images."""
        features = self.network(images)
        return {stride: features[position] for stride, position in self.positions.items()}


def build_backbone(name: str, weights: str = "imagenet", frozen: int = 0) -> Backbone:
    """Build a backbone by name.

    Args:
        name: `efficientnet_lite0`, one of `TORCHVISION`, or `timm/<name>` for any of timm's networks.
        weights: `imagenet`, `none`, or the path of a state dict in the layout of the name's package.
        frozen: Number of leading layers that keep their weights and statistics in training; not for timm's.

    Raises:
        ValueError: The name is unknown, or layers are to be frozen that are not there.
        ModuleNotFoundError: A package is missing; the message says how to get it.
        RuntimeError: ImageNet weights cannot be downloaded, or a file holds those of another network.
        FileNotFoundError: The file of weights does not exist.
    """
    if name == EFFICIENTNET_LITE0:
        layers = efficientnet_lite0()
        if weights != "none":
            known = imagenet_weights() if weights == "imagenet" else renamed(_read(name, weights))
            layers.load_state_dict(known)
        return LayeredBackbone(layers, (MEAN, STANDARD_DEVIATION), frozen)
    if name in TORCHVISION:
        return LayeredBackbone(_torchvision(name, weights), IMAGENET, frozen)
    if not name.startswith(TIMM):
        raise ValueError(
            f"Unknown backbone {name!r}; known ones are {[EFFICIENTNET_LITE0, *TORCHVISION]} and "
            f"{TIMM}<name> for any network of the package timm."
        )
    if frozen:
        raise ValueError(
            f"model.encoder.frozen={frozen}, and layers of timm's networks cannot be frozen; use 0."
        )
    return TimmBackbone(name.removeprefix(TIMM), weights)


def _torchvision(name: str, weights: str) -> nn.Sequential:
    """Layers of one of torchvision's networks without its classifier."""
    # Imported here, so that the other backbones do not need it.
    from torchvision import models

    network = models.get_model(name, weights=None)
    if weights != "none":
        network.load_state_dict(
            _downloaded(name) if weights == "imagenet" else _read(name, weights)
        )
    if name.startswith("resnet"):
        return nn.Sequential(*list(network.children())[:-2])
    return nn.Sequential(*network.features)


def _taps(layers: nn.Sequential) -> tuple[dict[int, int], dict[int, int]]:
    """Stride by index of the last layer with this stride, and channels by stride."""
    features = torch.zeros(1, 3, _PROBE, _PROBE)
    last, channels = {}, {}
    layers.eval()
    with torch.no_grad():
        for index, layer in enumerate(layers):
            features = layer(features)
            stride = _PROBE // features.shape[-1]
            last[stride], channels[stride] = index, int(features.shape[1])
    layers.train()
    return {last[stride]: stride for stride in STRIDES}, {s: channels[s] for s in STRIDES}


def _read(name: str, weights: str) -> dict[str, Tensor]:
    path = Path(weights).expanduser()
    if not path.is_file():
        raise FileNotFoundError(
            f"No file of weights at {path}. Give `model.encoder.weights` as `imagenet`, `none`, "
            f"or the path of a {name} state dict in its package's layout."
        )
    expected = f"a state dict of {name} in its package's layout"
    with naming(path, expected):
        refuse_packed(path)
        try:
            loaded = torch.load(path, map_location="cpu", weights_only=True)
        except (RuntimeError, LookupError, TypeError, AttributeError, AssertionError) as error:
            raise ValueError(str(error)) from error
        if not isinstance(loaded, dict) or not all(
            isinstance(one, Tensor) for one in loaded.values()
        ):
            raise ValueError(f"it holds a {type(loaded).__name__} of something else than tensors")
        return loaded


def _downloaded(name: str) -> dict[str, Tensor]:
    from torchvision import models

    source = models.get_model_weights(name).DEFAULT
    try:
        return dict(source.get_state_dict(progress=False, check_hash=True))
    except (URLError, OSError) as error:
        raise RuntimeError(
            f"Could not download torchvision's ImageNet weights for {name} ({error}). On a machine "
            f"without network, fetch {source.url.rsplit('/', 1)[-1]} elsewhere and put it into "
            f"{torch.hub.get_dir()}/checkpoints/, or give its path as model.encoder.weights=<file>, or "
            "train from random weights explicitly with model.encoder.weights=none."
        ) from error
