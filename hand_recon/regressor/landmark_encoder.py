"""Features of 2D landmarks in place of an image, with which the regressor lifts landmarks to 3D."""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.regressor.encoder import Encoder, Evidence
from hand_recon.schema import HandBatch


class LandmarkEncoder(Encoder):
    """A small residual network over the 2D landmarks of any detector.

    Its input is each landmark relative to the hand's centre and size, whether it is labelled, and the
    detector's confidence; also the hand's centre and size in the crop.

    In training, some landmarks are dropped from the input while their labels still count in the loss. Their
    residuals are then errors of the lifter and of the label. Without this, the network could copy every
    label, outliers included, and no σ could be learnt (decision 31).

    Args:
        width: Size of the hidden layers, and number of features.
        depth: Hidden layers after the first.
        landmark_dropout: Mean share of landmarks dropped from the input in training, 0 to 1.
        confidence: Whether the detector's confidence is part of the input.
    """

    has_landmarks = True

    def __init__(
        self,
        width: int = 512,
        depth: int = 2,
        landmark_dropout: float = 0.15,
        *,
        confidence: bool = True,
    ) -> None:
        super().__init__()
        if not 0 <= landmark_dropout < 1:
            raise ValueError(
                "landmark_dropout is a share of landmarks, at least 0 and less than 1; found "
                f"landmark_dropout={landmark_dropout}."
            )
        self.landmark_dropout = landmark_dropout
        self.confidence = confidence
        self.feature_size = width
        self.first = nn.Linear(5 * 21 + 3, width)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.ReLU(), nn.Linear(width, width)) for _ in range(depth)
        )

    def shown(self, batch: HandBatch) -> HandBatch:
        """The batch as the network sees it: in training, without the dropped landmarks."""
        if not self.training or not self.landmark_dropout:
            return batch
        return replace(batch, labelled=batch.labelled & self._kept(batch.labelled))

    def forward(self, batch: HandBatch) -> Evidence:
        """Evidence from the batch's 2D landmarks; images are not used."""
        shown = self.shown(batch)
        return Evidence(self.features(shown), shown.landmarks_2d, shown.labelled)

    def features(self, batch: HandBatch) -> Float[Tensor, "batch feature"]:
        """Features of the landmarks of a batch that are labelled."""
        shown = batch.labelled
        pixels = batch.landmarks_2d * (REFERENCE_SIZE / batch.crop_size)
        pixels = pixels.masked_fill(~shown[..., None], 0.0)
        count = shown.sum(dim=-1, keepdim=True).clamp(min=1)
        centre = pixels.sum(dim=-2) / count
        offset = (pixels - centre[:, None]).masked_fill(~shown[..., None], 0.0)
        size = (offset.square().sum(dim=(-2, -1)) / count[:, 0]).clamp(min=1.0).sqrt()
        confidence, known = self._confidence(batch, shown)
        seen = torch.cat(
            [
                (offset / size[:, None, None]).flatten(1), shown.float(), confidence, known,
                centre / (REFERENCE_SIZE / 2) - 1, size.log()[:, None] - 4,
            ],
            dim=-1,
        )  # fmt: skip
        features: Tensor = self.first(seen)
        for block in self.blocks:
            features = features + block(features)
        return torch.relu(features)

    def _kept(
        self, labelled: Bool[Tensor, "batch landmark=21"]
    ) -> Bool[Tensor, "batch landmark=21"]:
        """Mask of landmarks that are not dropped; a hand's share is from 0 to 2 · `landmark_dropout`."""
        share = 2 * self.landmark_dropout * torch.rand(len(labelled), 1, device=labelled.device)
        return torch.rand(labelled.shape, device=labelled.device) >= share

    def _confidence(
        self, batch: HandBatch, shown: Bool[Tensor, "batch landmark=21"]
    ) -> tuple[Float[Tensor, "batch landmark=21"], Float[Tensor, "batch landmark=21"]]:
        """The detector's confidence and whether there is one, both zero where a landmark is not shown."""
        if batch.confidence is None or not self.confidence:
            zeros = torch.zeros_like(batch.landmarks_2d[..., 0])
            return zeros, zeros
        known = batch.confidence.isfinite() & shown
        return batch.confidence.masked_fill(~known, 0.0), known.float()
