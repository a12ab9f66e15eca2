"""Training step without the backbone, beside forward and backward of a ResNet-50 (Sec. 3.4, 4.1)."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import torch
import torchvision
from torch import Tensor, nn

from hand_recon.evaluation.hand_scores import Scores
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.regressor.encoder import Encoder, Evidence
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.schema import HandBatch
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.rows import Row, Spread
from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty import NegativeLogLikelihood

BATCH: Final = 64
FEATURES: Final = 2048
"""Features of a ResNet-50."""
IMAGES: Final = 16
"""Images of one run of the ResNet-50 on a processor; its time per image hardly depends on it."""


class FixedFeatures(Encoder):
    """Encoder that returns the same features for every batch, with a gradient, in place of a backbone."""

    def __init__(self, hands: int) -> None:
        """Draw the features.

        Args:
            hands: Number of hands.
        """
        super().__init__()
        self.feature_size = FEATURES
        self.features = nn.Parameter(torch.randn(hands, FEATURES).abs())

    def forward(self, batch: HandBatch) -> Evidence:
        """The features."""
        return Evidence(self.features)


def measure(settings: Settings) -> Iterator[Row]:
    """Time the step with all knowledge, the optimizer's step, and a ResNet-50."""
    module, batch = training_module(BATCH, settings.device)
    images = BATCH if settings.device != "cpu" else (2 if settings.quick else IMAGES)
    network = torchvision.models.resnet50(weights=None).to(settings.device)
    works: dict[str, Work] = {
        "step": partial(step_without_backbone, module, batch),
        "network": partial(_forward_and_backward, network, random_images(images, settings.device)),
    }
    works |= {name: _optimizer_step(network, name) for name in ("foreach", "fused")}
    times = interleaved(works, settings)
    scale = BATCH / images
    times["network"] = [scale * seconds for seconds in times["network"]]
    shared = {
        "suite": "step",
        "size": f"{BATCH} crops",
        "items": BATCH,
        "reference": "ResNet-50 at 224 px, forward and backward"
        + ("" if images == BATCH else f", {images} images scaled"),
        "reference_seconds": spread(times["network"]),
    }
    yield Row(
        work="regressor, hand, camera, all knowledge and likelihood, forward and backward",
        seconds=spread(times["step"]),
        ratio=ratios(times["network"], times["step"]),
        wanted_ratio=20.0,
        note=f"{_percent(times['step'], times['network'])} of it; at most 5 % is wanted",
        **shared,  # type: ignore[arg-type]
    )
    for name in ("foreach", "fused"):
        yield Row(
            work=f"Adam's step of a ResNet-50, {name}",
            seconds=spread(times[name]),
            ratio=ratios(times["network"], times[name]),
            note=f"{_percent(times[name], times['network'])} of it",
            **shared,  # type: ignore[arg-type]
        )


def training_module(hands: int, device: str = "cpu") -> tuple[HandReconstruction, HandBatch]:
    """A training module with all knowledge and the likelihood but no backbone, and a batch for it.

    Args:
        hands: Number of hands.
        device: Device of torch.
    """
    hand = open_hand()
    regressor = Regressor(FixedFeatures(hands), hand)
    module = HandReconstruction(
        regressor,
        Prior.default(hand),
        NegativeLogLikelihood(),
        scores=partial(Scores, load_ranges("literature"), NonPenetration(hand)),
        optimizer=torch.optim.Adam,
    )
    batch = HandBatch(
        image=torch.zeros(hands, 3, 224, 224, dtype=torch.uint8),
        landmarks_2d=torch.rand(hands, 21, 2) * 224,
        labelled=torch.ones(hands, 21, dtype=torch.bool),
        index=torch.arange(hands),
        source=("random",) * hands,
    )
    return module.to(device), batch.to(device)


def step_without_backbone(module: HandReconstruction, batch: HandBatch) -> Tensor:
    """One training step up to the gradients: prediction, all losses, backward.

    Args:
        module: The module.
        batch: Labels.
    """
    module.zero_grad(set_to_none=True)
    loss: Tensor = module.training_step(batch, 0)["loss"]
    loss.backward()
    return loss.detach()


def random_images(count: int, device: str) -> Tensor:
    """Normalized images of noise, 224 pixels.

    Args:
        count: Number of images.
        device: Device of torch.
    """
    generator = torch.Generator().manual_seed(0)
    return torch.randn(count, 3, 224, 224, generator=generator).to(device)


def _forward_and_backward(network: nn.Module, images: Tensor) -> None:
    network.zero_grad(set_to_none=True)
    network(images).square().mean().backward()


def _optimizer_step(network: nn.Module, name: str) -> Callable[[], object]:
    """A step of Adam in one of its implementations, on copies of a network's parameters."""
    parameters = [nn.Parameter(one.detach().clone()) for one in network.parameters()]
    for parameter in parameters:
        parameter.grad = torch.randn_like(parameter)
    optimizer = torch.optim.Adam(parameters, lr=1e-5, **{name: True})  # type: ignore[arg-type]
    return optimizer.step


def _percent(part: list[float], whole: list[float]) -> str:
    share: Spread = spread([100 * one / other for one, other in zip(part, whole, strict=True)])
    return f"{share.median:.2g} %"
