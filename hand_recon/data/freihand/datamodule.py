"""FreiHAND for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any

import torch

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule, HandDataset
from hand_recon.data.freihand.dataset import FreiHand
from hand_recon.data.freihand.splits import FreiHandRecipe, training_mano
from hand_recon.hand.mano_labels import freihand_parameters
from hand_recon.hand.mano_layer import ManoLayer
from hand_recon.schema import HandParameters


class FreiHandDataModule(HandDataModule):
    """Real hands in FreiHAND's layout."""

    name = "freihand"
    landmarks = "mano"

    def __init__(
        self,
        root: Path | str,
        *,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        mano: Path | str | None = None,
        landmarks: str = "mano",
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        **recipe: Any,  # noqa: ANN401  # The fields of `FreiHandRecipe`, which checks them.
    ) -> None:
        """Remember what to read.

        Args:
            root: The folder that holds `training_xyz.json`.
            crop: Size and place of the crops.
            reading: Caches, and how many damaged pictures are too many.
            mano: The folder of the user's MANO, for `train_parameters` alone.
            landmarks: The hand's landmark set that the labels follow.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of `hand_recon.data.freihand.splits.FreiHandRecipe`.
        """
        self.landmarks = landmarks
        self.mano = mano
        crop = crop or CropPolicy()
        self.recipe = FreiHandRecipe(root, crop=crop, reading=reading or ReadingPolicy(), **recipe)
        super().__init__(
            partial(FreiHand, "train", self.recipe),
            partial(FreiHand, "val", self.recipe),
            partial(FreiHand, "test", self.recipe),
            crop_size=crop.size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """A split with its surfaces, as far as they compare with the hand model's."""
        return FreiHand(split, self.recipe, with_vertices=True)

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, from `training_mano.json` and the user's own MANO.

        Raises:
            FileNotFoundError: There are labels, and MANO is not there.
        """
        found = None if self.mano is None else training_mano(self.recipe)
        if found is None or self.mano is None:
            return None
        labels, intrinsics = (torch.from_numpy(array).float() for array in found)
        count = min(limit or len(labels), len(labels))
        chosen = torch.arange(count) * len(labels) // count
        layer = ManoLayer.load(self.mano, landmarks="mano")
        with torch.no_grad():
            return layer.hand_parameters(
                *freihand_parameters(layer, labels[chosen], intrinsics[chosen])
            )
