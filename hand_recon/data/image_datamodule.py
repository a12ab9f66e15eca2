"""Base class of datamodules of real images: a recipe and one dataset per split (Sec. 4.1)."""

from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.augment import Augmentation
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import HandDataset


class ImageDataModule(HandDataModule):
    """Datamodule of real images in a dataset's layout; a subclass names its dataset and recipe classes."""

    recipe_type: ClassVar[Any]
    """Recipe class; takes the location, `crop`, `reading` and fields of its own."""
    dataset_type: ClassVar[Any]
    """Dataset class; takes a split, a recipe and `with_vertices`."""
    default_crop: ClassVar[CropPolicy] = CropPolicy()
    """Crop policy used by default."""

    def __init__(
        self,
        *location: Path | str | None,
        crop: CropPolicy | None = None,
        reading: ReadingPolicy | None = None,
        landmark_set: str | None = None,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        keep: str = "disk",
        **recipe: Any,  # noqa: ANN401  # The recipe's other fields, which it checks.
    ) -> None:
        """Store the settings; files are read on first use.

        Args:
            *location: Location of the files: the recipe's first fields.
            crop: Size and position of the crops.
            reading: Caches and the number of damaged images allowed.
            landmark_set: Landmark set that the labels follow; None for the dataset's own.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Seed of the sample order and of the augmentation.
            keep: Place of the samples of training and validation: `disk`, `memory` or `device`.
            **recipe: Other fields of the recipe.
        """
        self.landmark_set = landmark_set or type(self).landmark_set
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
            keep=keep,
        )

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """The dataset of a split with the surfaces that are comparable with the hand model's."""
        dataset: HandDataset = self.dataset_type(split, self.recipe, with_vertices=True)
        return dataset

    def _split(self, split: str) -> HandDataset:
        dataset: HandDataset = self.dataset_type(split, self.recipe)
        return dataset


class LabelledImageDataModule(ImageDataModule):
    """Images with 2D labels and no 3D ground truth."""

    default_crop = CropPolicy(around="joints")

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """The dataset of a split, which has no surfaces."""
        return self.dataset(split)

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """None: images with 2D labels have no 3D ground truth, so no image is read."""
        del limit
        return None
