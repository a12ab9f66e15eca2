"""2D error and PCK of the projected landmarks, which need no 3D ground truth."""

from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.per_sample import PerSampleMetric

PCK_THRESHOLDS: Final = (0.05, 0.1, 0.15)
"""PCK thresholds as shares of the crop's side: those of HInt (CVPR 2024)."""


def landmark_error_2d(
    prediction: Float[Tensor, "*batch landmark 2"],
    labels: Float[Tensor, "*batch landmark 2"],
    labelled: Bool[Tensor, "*batch landmark"],
    crop_size: int,
) -> Float[Tensor, "*batch landmark"]:
    """Distance of each landmark from its label, pixels of the 224 crop; NaN without label.

    Args:
        prediction: Projected landmarks, pixels of the crop.
        labels: Labels, pixels of the crop; any value where there is none.
        labelled: Landmarks that have a label.
        crop_size: Side of the crop, pixels.
    """
    distance = torch.linalg.vector_norm(prediction.double() - labels.double(), dim=-1)
    distance = distance * (REFERENCE_SIZE / crop_size)
    return torch.where(labelled, distance, torch.nan)


class Landmarks2D(PerSampleMetric):
    """Mean error over all labelled landmarks (`E_2D`, pixels of the 224 crop) and PCK.

    `PCK@0.05` is the share of labelled landmarks within 5 % of the crop's side of their label.
    Every label has the same weight, so that a hand with few labels counts less. Without labels the
    result is empty.
    """

    def __init__(self) -> None:
        """Create an empty metric."""
        super().__init__({"landmarks": 2 + len(PCK_THRESHOLDS)})

    def update(
        self,
        prediction: Float[Tensor, "hand landmark 2"],
        labels: Float[Tensor, "hand landmark 2"],
        labelled: Bool[Tensor, "hand landmark"],
        index: Int[Tensor, " hand"],
        *,
        crop_size: int,
    ) -> None:
        """Add a batch.

        Args:
            prediction: Projected landmarks, pixels of the crop.
            labels: Labels, pixels of the crop.
            labelled: Landmarks that have a label.
            index: Position of each sample in its dataset: a repeated sample counts once.
            crop_size: Side of the crop, pixels.

        Raises:
            ValueError: A prediction is not finite.
        """
        require_finite("2D landmarks", prediction, index)
        # First to the CPU: not every accelerator knows double precision.
        errors = landmark_error_2d(prediction.cpu(), labels.cpu(), labelled.cpu(), crop_size)
        # A comparison with NaN is false: a landmark without label is never within a threshold.
        within = [(errors <= share * REFERENCE_SIZE).sum(dim=-1) for share in PCK_THRESHOLDS]
        count = errors.isfinite().sum(dim=-1)
        self.record(index, landmarks=torch.stack([errors.nansum(dim=-1), *within, count], dim=-1))

    def compute(self) -> dict[str, float]:
        """Mean error and PCK over the labelled landmarks of distinct samples.

        Raises:
            ValueError: An index is not unique.
        """
        totals = self.distinct("landmarks").sum(dim=0).tolist()
        if totals[-1] == 0:
            return {}
        names = ("E_2D", *(f"PCK@{share:.2f}" for share in PCK_THRESHOLDS))
        return {name: total / totals[-1] for name, total in zip(names, totals, strict=False)}
