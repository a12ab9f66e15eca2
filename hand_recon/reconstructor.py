"""The regressor: image features, then error feedback to pose, shape, camera and σ (Sec. 3, 4.1)."""

from pathlib import Path
from typing import Final
from urllib.error import URLError

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torchvision import models

from hand_recon.camera import (
    bounded_log_scale,
    default_intrinsics,
    project,
    raw_to_translation,
    six_d_to_rotation,
    to_true_camera,
)
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandParameters, HandPrediction

_SIZES: Final = {"joint_angles": 45, "root": 6, "camera": 3, "shape": 10, "log_sigma": 42}
STATE_SIZE: Final = sum(_SIZES.values())
"""Numbers that the regressor refines: 45 + 6 + 3 + 10 + 42."""

BACKBONES: Final = ("resnet18", "resnet34", "resnet50", "mobilenet_v3_small", "mobilenet_v3_large")
"""Backbones by torchvision's names; the paper's is ResNet-50."""

_MEAN: Final = (0.485, 0.456, 0.406)
_STANDARD_DEVIATION: Final = (0.229, 0.224, 0.225)


class ImageEncoder(nn.Module):
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

    def forward(
        self, image: Float[Tensor, "batch 3 height width"]
    ) -> Float[Tensor, "batch feature"]:
        """Features of RGB crops with values in 0–1."""
        normalised = (image - self.mean) / self.standard_deviation
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


class Reconstructor(nn.Module):
    """Features → pose, shape, camera and log σ by three rounds of error feedback (Sec. 4.1).

    As in the authors' network, each round sees the features and its own last answer, log σ included,
    and predicts a correction through two linear layers.

    Args:
        encoder: Features of the input.
        hand: The hand model that turns the answer into a mesh.
        iterations: Rounds of feedback.
        width: Size of the two hidden layers.
        dropout: After each hidden layer.
        activation: Whether the hidden layers are non-linear; the authors' are not.
        use_intrinsics: Place the hand in the camera that the batch knows, where it knows one, in
            place of the constant focal length of Sec. 3.1.
    """

    initial_state: Tensor

    def __init__(
        self,
        encoder: ImageEncoder,
        hand: HandModel,
        *,
        iterations: int = 3,
        width: int = 1024,
        dropout: float = 0.5,
        activation: bool = False,
        use_intrinsics: bool = False,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.hand = hand
        self.iterations = iterations
        self.use_intrinsics = use_intrinsics
        self.regressor = nn.Sequential(
            nn.Linear(encoder.feature_size + STATE_SIZE, width),
            nn.ReLU() if activation else nn.Identity(),
            nn.Dropout(dropout),
            nn.Linear(width, width),
            nn.ReLU() if activation else nn.Identity(),
            nn.Dropout(dropout),
        )
        self.decoders = nn.ModuleDict(
            {name: nn.Linear(width, size) for name, size in _SIZES.items()}
        )
        for name, parameter in self.decoders.named_parameters():
            if name.endswith("weight"):
                nn.init.xavier_uniform_(parameter, gain=0.01)
            else:
                nn.init.zeros_(parameter)
        self.register_buffer("initial_state", _initial_state())

    def forward(
        self,
        image: Float[Tensor, "batch 3 height width"],
        intrinsics: Float[Tensor, "batch 3 3"] | None = None,
    ) -> HandPrediction:
        """Reconstruct the hand in each crop.

        Args:
            image: Square RGB crops with values in 0–1.
            intrinsics: Camera matrix of each crop, pixels of the crop.
        """
        features = self.encoder(image)
        # Rotations and projections lose their meaning in half precision, so only the backbone has it.
        with torch.autocast(device_type=image.device.type, enabled=False):
            state = self._feedback(features.float())
            return self._reconstruct(state, image.shape[-1], intrinsics)

    def _feedback(self, features: Tensor) -> Tensor:
        state = self.initial_state.expand(len(features), -1)
        for _ in range(self.iterations):
            hidden = self.regressor(torch.cat([features, state], dim=-1))
            state = state + torch.cat(
                [decoder(hidden) for decoder in self.decoders.values()], dim=-1
            )
        return state

    def _reconstruct(
        self, state: Tensor, crop_size: int, intrinsics: Tensor | None
    ) -> HandPrediction:
        parts = dict(zip(_SIZES, state.split(list(_SIZES.values()), dim=-1), strict=True))
        rotation = six_d_to_rotation(parts["root"])
        scale = bounded_log_scale(parts["camera"][..., :1])
        translation = raw_to_translation(torch.cat([scale, parts["camera"][..., 1:]], dim=-1))
        camera = default_intrinsics(crop_size, state).expand(len(state), 3, 3)
        if self.use_intrinsics and intrinsics is not None:
            camera = intrinsics
            rotation, translation = to_true_camera(rotation, translation, camera, crop_size)
        parameters = HandParameters(
            parts["joint_angles"].unflatten(-1, (15, 3)), parts["shape"], rotation, translation
        )
        hand = self.hand.place(parameters)
        return HandPrediction(
            parameters=parameters,
            vertices=hand.vertices,
            joints=hand.joints,
            landmarks_3d=hand.landmarks,
            landmarks_2d=project(hand.landmarks, camera),
            log_sigma=parts["log_sigma"].unflatten(-1, (21, 2)),
            intrinsics=camera,
        )


def _initial_state() -> Float[Tensor, " state"]:
    """Where the feedback starts: a slightly bent hand, upright, that fills two thirds of the crop.

    The authors' starting values are not public; these follow from the camera (`docs/decisions.md`).
    """
    angles = torch.zeros(15, 3)
    angles[:, 0] = 0.3
    # Columns of a rotation that points the fingers (−x) up and shows the palm (−y) to the camera.
    root = torch.tensor([0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    camera = torch.tensor([6.7, 0.0, 0.0])
    log_sigma = torch.full((42,), 1.5)
    return torch.cat([angles.flatten(), root, camera, torch.zeros(10), log_sigma])
