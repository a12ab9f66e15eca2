"""Features of images from a torchvision backbone (Sec. 4.1)."""

from pathlib import Path
from typing import Final
from urllib.error import URLError

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torchvision import models

from hand_recon.regressor.encoder import Encoder
from hand_recon.schema import HandBatch

BACKBONES: Final = ("resnet18", "resnet34", "resnet50", "mobilenet_v3_small", "mobilenet_v3_large")
"""Backbones by torchvision's names; the paper's is ResNet-50."""

_MEAN: Final = (0.485, 0.456, 0.406)
_STANDARD_DEVIATION: Final = (0.229, 0.224, 0.225)


class ImageEncoder(Encoder):
    """A torchvision backbone without its classifier.

    Args:
        backbone: One of `BACKBONES`.
        weights: `imagenet`, `none`, or the path of a state dict in torchvision's layout.
        grid: Cells per side of the grid over which features are averaged. 1 is the paper's average pool; 2 or
            more keep spatial information, which a small network trained from scratch needs (decision 19).

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
        # Convolutions are fastest with channels last, on CPUs by a third.
        self.layers.to(memory_format=torch.channels_last)
        self.pool = nn.AdaptiveAvgPool2d(grid)
        self.feature_size = channels * grid * grid
        self.register_buffer("mean", torch.tensor(_MEAN)[:, None, None], persistent=False)
        self.register_buffer(
            "standard_deviation", torch.tensor(_STANDARD_DEVIATION)[:, None, None], persistent=False
        )

    def forward(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of the batch's images, floats 0–1; nothing else of the batch is used.

        Raises:
            ValueError: There are no images.
        """
        if not batch.image.numel():
            raise ValueError(
                "This model needs images, and these data have landmarks alone. Use model=lifter with "
                "them, or data with images."
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
