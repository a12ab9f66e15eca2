"""Pictures of hands with 2D landmarks alone for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits


class LandmarkDataModule(HandDataModule):
    """Anybody's pictures: COCO keypoints, JSON, CSV or HInt; no 3D, so its scores are 2D ones."""

    name = "landmarks"

    def __init__(
        self,
        train: Path | str,
        *,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        landmarks: str = "knuckle",
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        **recipe: Any,  # noqa: ANN401  # The fields of `LandmarkRecipe`, which checks them.
    ) -> None:
        """Remember what to read.

        Args:
            train: Landmarks of the training pictures, a file or a folder.
            crop: Size and place of the crops.
            reading: Caches, and how many missing or damaged pictures are too many.
            landmarks: The hand's landmark set that the labels follow: people mark knuckles.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of `hand_recon.data.landmarks.splits.LandmarkRecipe`.
        """
        self.landmarks = landmarks
        crop = crop or CropPolicy(around="joints")
        self.recipe = LandmarkRecipe(train, crop=crop, reading=reading or ReadingPolicy(), **recipe)
        splits = LandmarkSplits(self.recipe)
        super().__init__(
            partial(splits.dataset, "train"),
            partial(splits.dataset, "val"),
            partial(splits.dataset, "test"),
            crop_size=crop.size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """None: there is no 3D, and no picture has to be read to know it."""
        del limit
        return None
