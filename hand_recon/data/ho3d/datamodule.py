"""HO3D for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule, HandDataset
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.schema import HandParameters


class Ho3dDataModule(HandDataModule):
    """Real right hands in HO3D's layout."""

    name = "ho3d"
    landmarks = "ho3d"

    def __init__(
        self,
        root: Path | str,
        version: str = "v3",
        *,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        landmarks: str = "ho3d",
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        **recipe: Any,  # noqa: ANN401  # The fields of `Ho3dRecipe`, which checks them.
    ) -> None:
        """Remember what to read.

        Args:
            root: The folder that holds `train.txt` and `evaluation.txt`.
            version: `v3` or `v2`.
            crop: Size and place of the crops.
            reading: Caches, and how many damaged pictures are too many.
            landmarks: The hand's landmark set that the labels follow.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of `hand_recon.data.ho3d.dataset.Ho3dRecipe`.
        """
        self.landmarks = landmarks
        crop = crop or CropPolicy(around="joints")
        self.recipe = Ho3dRecipe(
            root, version, crop=crop, reading=reading or ReadingPolicy(), **recipe
        )
        super().__init__(
            partial(Ho3d, "train", self.recipe),
            partial(Ho3d, "val", self.recipe),
            partial(Ho3d, "test", self.recipe),
            crop_size=crop.size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """A split with its surfaces, as far as they compare with the hand model's."""
        return Ho3d(split, self.recipe, with_vertices=True)

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """What the annotations say of the training hands, through the user's MANO; none without it."""
        dataset = self.dataset("train")
        hands = dataset.mano_hands() if isinstance(dataset, Ho3d) else None
        if hands is None or not isinstance(dataset, Ho3d):
            return None
        count = min(limit or len(dataset), len(dataset))
        return hands.parameters(dataset.rows[np.arange(count) * len(dataset) // count])
