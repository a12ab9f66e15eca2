"""What datamodules of real images share: a recipe, and a dataset made of it for each split (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule, HandDataset


class ImageDataModule(HandDataModule):
    """Real images in some dataset's layout. A subclass names its dataset and what describes it."""

    recipe_type: ClassVar[Any]
    """A record of what to read: takes the place, `crop`, `reading` and fields of its own."""
    dataset_type: ClassVar[Any]
    """Takes a split, a recipe and `with_vertices`."""
    default_crop: ClassVar[CropPolicy] = CropPolicy()
    """How crops are cut where nothing is said."""

    def __init__(
        self,
        *location: Path | str | None,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        landmarks: str | None = None,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        **recipe: Any,  # noqa: ANN401  # The recipe's other fields, which it checks.
    ) -> None:
        """Remember what to read.

        Args:
            *location: The recipe's first fields: where the files are.
            crop: Size and position of the crops.
            reading: Caches, and how many damaged images are too many.
            landmarks: The hand's landmark set that the labels follow; none for the dataset's own.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            **recipe: Other fields of the recipe.
        """
        self.landmarks = landmarks or type(self).landmarks
        crop = crop or self.default_crop
        self.recipe = self.recipe_type(
            *location, crop=crop, reading=reading or ReadingPolicy(), **recipe
        )
        super().__init__(
            partial(self._split, "train"),
            partial(self._split, "val"),
            partial(self._split, "test"),
            crop_size=crop.size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """A split with its surfaces, as far as they compare with the hand model's."""
        dataset: HandDataset = self.dataset_type(split, self.recipe, with_vertices=True)
        return dataset

    def _split(self, split: str) -> HandDataset:
        dataset: HandDataset = self.dataset_type(split, self.recipe)
        return dataset
