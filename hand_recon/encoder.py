"""Features of what the regressor is shown: pictures (Sec. 4.1), or the 2D landmarks of a detector."""

from abc import ABC, abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Final
from urllib.error import URLError

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torchvision import models

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.schema import HandBatch

BACKBONES: Final = ("resnet18", "resnet34", "resnet50", "mobilenet_v3_small", "mobilenet_v3_large")
"""Backbones by torchvision's names; the paper's is ResNet-50."""

_MEAN: Final = (0.485, 0.456, 0.406)
_STANDARD_DEVIATION: Final = (0.229, 0.224, 0.225)


class Encoder(nn.Module, ABC):
    """What the regressor asks of every encoder."""

    feature_size: int
    """Number of features."""

    def shown(self, batch: HandBatch) -> HandBatch:
        """The batch as the network may see it."""
        return batch

    @abstractmethod
    def forward(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of every hand of a batch."""


class ImageEncoder(Encoder):
    """A torchvision backbone, its classifier removed.

    Args:
        backbone: One of `BACKBONES`.
        weights: `imagenet`, `none`, or the path of a state dict in torchvision's layout.
        grid: The features are averaged over a grid of this many cells per side. 1 is the paper's
            average pool; 2 or more keeps where things are, which a small network trained from
            scratch needs (`docs/decisions.md`).

    Raises:
        ValueError: The backbone is unknown.
        RuntimeError: The ImageNet weights cannot be downloaded.
        FileNotFoundError: The file of weights does not exist.
    """

    mean: Tensor
    standard_deviation: Tensor

    def __init__(
        self, backbone: str = "resnet50", weights: str = "imagenet", grid: int = 1
    ) -> None:
        super().__init__()
        if backbone not in BACKBONES:
            raise ValueError(f"Unknown backbone {backbone!r}; known ones are {list(BACKBONES)}.")
        network = models.get_model(backbone, weights=None)
        if weights != "none":
            network.load_state_dict(_backbone_weights(backbone, weights))
        if backbone.startswith("resnet"):
            layers = list(network.children())[:-2]
            channels = int(network.fc.in_features)
        else:
            layers = [network.features]
            channels = int(network.features[-1].out_channels)
        self.layers = nn.Sequential(*layers)
        # Channels last: the order in which convolutions are fastest, on CPUs by a third.
        self.layers.to(memory_format=torch.channels_last)
        self.pool = nn.AdaptiveAvgPool2d(grid)
        self.feature_size = channels * grid * grid
        self.register_buffer("mean", torch.tensor(_MEAN)[:, None, None], persistent=False)
        self.register_buffer(
            "standard_deviation", torch.tensor(_STANDARD_DEVIATION)[:, None, None], persistent=False
        )

    def forward(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of the pictures, as floats 0–1; nothing else of the batch is looked at.

        Raises:
            ValueError: There are no pictures.
        """
        if not batch.image.numel():
            raise ValueError(
                "This model looks at pictures, and these data have landmarks alone. Use model=lifter with "
                "them, or data with pictures."
            )
        normalised = (batch.image - self.mean) / self.standard_deviation
        normalised = normalised.contiguous(memory_format=torch.channels_last)
        features: Tensor = self.pool(self.layers(normalised)).flatten(1)
        return features


def _backbone_weights(backbone: str, weights: str) -> dict[str, Tensor]:
    """The state dict that `weights` names; see `ImageEncoder`."""
    if weights != "imagenet":
        path = Path(weights).expanduser()
        if not path.is_file():
            raise FileNotFoundError(
                f"No file of weights at {path}. Give `model.encoder.weights` as `imagenet`, `none`, "
                f"or the path of a {backbone} state dict in torchvision's layout."
            )
        loaded: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
        return loaded
    source = models.get_model_weights(backbone).DEFAULT
    try:
        return dict(source.get_state_dict(progress=False, check_hash=True))
    except (URLError, OSError) as error:
        raise RuntimeError(
            f"Could not download torchvision's ImageNet weights for {backbone} ({error}). On a machine "
            f"without network, fetch {source.url.rsplit('/', 1)[-1]} elsewhere and put it into "
            f"{torch.hub.get_dir()}/checkpoints/, or give its path as model.encoder.weights=<file>, or "
            "train from random weights explicitly with model.encoder.weights=none."
        ) from error


class LandmarkEncoder(Encoder):
    """A small network over 2D landmarks: with it, the regressor lifts any detector's output to 3D.

    It sees each landmark relative to the hand's centre and size, whether it is there, and how sure the
    detector was of it; and where in the crop the hand is, and how large.

    In training, some landmarks are hidden from it although their labels count in the loss. Their errors are
    then errors of the lifter and of the label, not of a network that was shown the label: without this,
    no σ could be learnt, and every outlier would be copied (`docs/decisions.md`).

    Args:
        width: Size of the hidden layers, and number of features.
        depth: Hidden layers after the first.
        hidden: Share of landmarks hidden in training.
        confidence: Whether it is told how sure the detector was.
    """

    def __init__(
        self, width: int = 512, depth: int = 2, hidden: float = 0.15, *, confidence: bool = True
    ) -> None:
        super().__init__()
        if not 0 <= hidden < 1:
            raise ValueError(f"hidden={hidden} is a share of landmarks: at least 0, less than 1.")
        self.hidden = hidden
        self.confidence = confidence
        self.feature_size = width
        self.first = nn.Linear(5 * 21 + 3, width)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.ReLU(), nn.Linear(width, width)) for _ in range(depth)
        )

    def shown(self, batch: HandBatch) -> HandBatch:
        """The batch as the network sees it: in training, with some landmarks hidden."""
        if not self.training or not self.hidden:
            return batch
        return replace(batch, labelled=batch.labelled & self._not_hidden(batch.labelled))

    def forward(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of the batch's 2D landmarks; pictures are not looked at."""
        shown = batch.labelled
        place = batch.landmarks_2d * (REFERENCE_SIZE / batch.crop_size)
        place = place.masked_fill(~shown[..., None], 0.0)
        count = shown.sum(dim=-1, keepdim=True).clamp(min=1)
        centre = place.sum(dim=-2) / count
        offset = (place - centre[:, None]).masked_fill(~shown[..., None], 0.0)
        size = (offset.square().sum(dim=(-2, -1)) / count[:, 0]).clamp(min=1.0).sqrt()
        sure, told = self._confidence(batch, shown)
        seen = torch.cat(
            [
                (offset / size[:, None, None]).flatten(1), shown.float(), sure, told,
                centre / (REFERENCE_SIZE / 2) - 1, size.log()[:, None] - 4,
            ],
            dim=-1,
        )  # fmt: skip
        features: Tensor = self.first(seen)
        for block in self.blocks:
            features = features + block(features)
        return torch.relu(features)

    def _not_hidden(
        self, labelled: Bool[Tensor, "batch landmark=21"]
    ) -> Bool[Tensor, "batch landmark=21"]:
        """Which landmarks training leaves visible: from no landmark hidden to twice the share."""
        share = 2 * self.hidden * torch.rand(len(labelled), 1, device=labelled.device)
        return torch.rand(labelled.shape, device=labelled.device) >= share

    def _confidence(
        self, batch: HandBatch, shown: Bool[Tensor, "batch landmark=21"]
    ) -> tuple[Float[Tensor, "batch landmark=21"], Float[Tensor, "batch landmark=21"]]:
        """The detector's score and whether there is one, both zero where a landmark is not shown."""
        if batch.confidence is None or not self.confidence:
            nothing = torch.zeros_like(batch.landmarks_2d[..., 0])
            return nothing, nothing
        told = batch.confidence.isfinite() & shown
        return batch.confidence.masked_fill(~told, 0.0), told.float()
