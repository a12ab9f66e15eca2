"""DexYCB for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule, HandDataset
from hand_recon.data.dexycb.dataset import AROUND_JOINTS, DexYcb, DexYcbRecipe
from hand_recon.schema import HandParameters


class DexYcbDataModule(HandDataModule):
    """Real right and left hands in DexYCB's layout."""

    name = "dexycb"
    landmarks = "dexycb"

    def __init__(
        self,
        root: Path | str | None = None,
        *,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        landmarks: str = "dexycb",
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        **recipe: Any,  # noqa: ANN401  # The fields of `DexYcbRecipe`, which checks them.
    ) -> None:
        """Remember what to read.

        Args:
            root: The folder that holds `20200709-subject-01`; missing is an error once it is read.
            crop: Size and place of the crops.
            reading: Caches, and how many damaged pictures are too many.
            landmarks: The hand's landmark set that the labels follow.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of `hand_recon.data.dexycb.dataset.DexYcbRecipe`.
        """
        self.landmarks = landmarks
        crop = crop or AROUND_JOINTS
        self.recipe = DexYcbRecipe(root, crop=crop, reading=reading or ReadingPolicy(), **recipe)
        super().__init__(
            partial(DexYcb, "train", self.recipe),
            partial(DexYcb, "val", self.recipe),
            partial(DexYcb, "test", self.recipe),
            crop_size=crop.size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """A split with its surfaces, as far as they compare with the hand model's."""
        return DexYcb(split, self.recipe, with_vertices=True)

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, left ones mirrored, through MANO.

        Args:
            limit: At most so many hands, spread evenly over the set.

        Returns:
            None, and a warning, where MANO is not there.
        """
        data = self.dataset("train")
        surfaces = data.surfaces() if isinstance(data, DexYcb) else None
        if surfaces is None:
            return None
        count = min(limit or len(surfaces), len(surfaces))
        rows = np.arange(count) * len(surfaces) // count
        with torch.no_grad():
            return surfaces.select(rows).parameters()
