"""Features of a detector's 2D landmarks: with them, the regressor lifts landmarks to 3D."""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.regressor.encoder import Encoder
from hand_recon.schema import HandBatch


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
