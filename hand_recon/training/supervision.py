"""3D labels for some of the pictures, where there are any: Table 3 (b) of the paper's discussion.

The method learns without them. To say what they would add, a share of the training pictures gives its 3D
landmarks away too; which ones is fixed by their place in the dataset: the same in every epoch and run. Of
a dataset that has several pictures of one hand, more hands than this share have a label somewhere.
"""

from typing import Final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.schema import HandBatch, HandPrediction

_SCATTER: Final = 2_654_435_761
"""Knuth's multiplicative hash: neighbours in a dataset, often frames of one recording, come apart."""


class Landmarks3D(nn.Module):
    """Squared 3D error of the landmarks about the hand's root, for a share of the hands.

    Args:
        fraction: Share of the training pictures whose 3D labels are used, 0–1.
        weight: Per squared metre; 500,000 weighs 10 mm at every landmark as the data term weighs 5 px.

    Raises:
        ValueError: The fraction is no share.
    """

    def __init__(self, fraction: float = 1.0, weight: float = 500_000.0) -> None:
        super().__init__()
        if not 0 <= fraction <= 1:
            raise ValueError(f"fraction={fraction} is a share of the hands: from 0 to 1.")
        self.fraction = fraction
        self.weight = weight

    def forward(self, batch: HandBatch, prediction: HandPrediction) -> Float[Tensor, " batch"]:
        """Squared metres, one value per hand; zero for hands whose 3D labels are not used.

        Raises:
            ValueError: The data have no 3D labels at all.
        """
        if batch.landmarks_3d is None:
            raise ValueError(
                "supervision=landmarks_3d needs data with 3D labels, and these have none. "
                "Use supervision=landmarks_2d."
            )
        used = self.chosen(batch.index) & batch.landmarks_3d.isfinite().flatten(1).all(dim=1)
        truth = _about_root(batch.landmarks_3d)
        # Masked before squaring: the gradient of a square at NaN would be NaN even times zero.
        error = (_about_root(prediction.landmarks_3d) - truth).masked_fill(
            ~used[:, None, None], 0.0
        )
        return error.square().sum(dim=(-2, -1))

    def chosen(self, index: Int[Tensor, " batch"]) -> Bool[Tensor, " batch"]:
        """Whether the 3D label of each hand is used.

        Args:
            index: Positions in the dataset.
        """
        place = (index.to(torch.int64) * _SCATTER) % 2**32
        return place < self.fraction * 2**32


def _about_root(landmarks: Float[Tensor, "batch landmark=21 3"]) -> Tensor:
    return landmarks - landmarks[:, ROOT_LANDMARK, None]
