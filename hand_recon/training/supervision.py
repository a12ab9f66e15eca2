"""3D supervision for a share of the training images, for comparison (Sec. 5, Table 3 (b)).

The method itself uses no 3D labels. To measure what they would add, a share of the training images also
supplies 3D landmarks. An image is chosen by its index in the dataset, so the choice is the same in every
epoch and run. Where a dataset has several images of one hand, more than this share of its hands have a label.
"""

from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.schema import HandBatch, HandPrediction

_HASH_FACTOR: Final = 2_654_435_761
"""Factor of Knuth's multiplicative hash, which spreads the choice over consecutive frames of a recording."""


class Landmarks3D(nn.Module):
    """Squared error of the root-relative 3D landmarks, for a share of the hands.

    Args:
        fraction: Share of the training images whose 3D labels are used, 0–1.
        weight: Factor of the loss, per squared metre; with 500,000, 10 mm at every landmark cost as much as
            5 px do in the data term.

    Raises:
        ValueError: The fraction is not between 0 and 1.
    """

    def __init__(self, fraction: float = 1.0, weight: float = 500_000.0) -> None:
        super().__init__()
        if not 0 <= fraction <= 1:
            raise ValueError(
                f"fraction is a share of the hands, from 0 to 1; found fraction={fraction}."
            )
        self.fraction = fraction
        self.weight = weight

    def forward(self, batch: HandBatch, prediction: HandPrediction) -> Float[Tensor, " batch"]:
        """Squared metres, one value per hand; zero for hands whose 3D labels are not used.

        Raises:
            ValueError: The data have no 3D labels at all.
        """
        if batch.landmarks_3d is None:
            raise ValueError(
                "supervision=landmarks_3d needs data with 3D labels, and these data have none. "
                "Use supervision=landmarks_2d."
            )
        used = self.chosen(batch.index) & batch.landmarks_3d.isfinite().flatten(1).all(dim=1)
        ground_truth = _root_relative(batch.landmarks_3d)
        # Masked before squaring: the gradient of a square at NaN would be NaN even times zero.
        error = (_root_relative(prediction.landmarks_3d) - ground_truth).masked_fill(
            ~used[:, None, None], 0.0
        )
        return error.square().sum(dim=(-2, -1))

    def chosen(self, index: Int[Tensor, " batch"]) -> Bool[Tensor, " batch"]:
        """Mask of hands whose 3D labels are used.

        Args:
            index: Positions in the dataset.
        """
        hashed = (index.to(torch.int64) * _HASH_FACTOR) % 2**32
        return hashed < self.fraction * 2**32


def _root_relative(landmarks: Float[Tensor, "batch landmark=21 3"]) -> Tensor:
    return landmarks - landmarks[:, ROOT_LANDMARK, None]
