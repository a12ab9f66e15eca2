"""FreiHAND for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.freihand.dataset import FreiHand, FreiHandRecipe


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
            landmarks: The hand's landmark set that the labels follow.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of `hand_recon.data.freihand.dataset.FreiHandRecipe`.
        """
        self.landmarks = landmarks
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
