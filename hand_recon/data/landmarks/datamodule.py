"""Lightning datamodule of images with 2D landmarks only (Sec. 4.1)."""

from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataset
from hand_recon.data.image_datamodule import ImageDataModule
from hand_recon.data.landmarks.exchanged import WithExchangedFingers
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits


class LandmarkDataModule(ImageDataModule):
    """Images with 2D landmarks from COCO, JSON, CSV or HInt files; without 3D, so scores are 2D only."""

    name = "landmarks"
    landmark_set = "knuckle"
    recipe_type = LandmarkRecipe
    default_crop = CropPolicy(around="joints")

    def __init__(self, *location: Path | str, **options: Any) -> None:  # noqa: ANN401  # Those of `ImageDataModule`.
        """Store the settings; files are read on first use.

        Args:
            *location: Landmarks of the training images, a file or a folder, unless given as `train`.
            **options: Those of `ImageDataModule`, and fields of `LandmarkRecipe`.
        """
        super().__init__(*location, **options)
        self._splits = LandmarkSplits(self.recipe)

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """The dataset of a split, which has no surfaces."""
        return self.dataset(split)

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """None: landmark files have no 3D ground truth, so no image is read."""
        del limit
        return None

    def _split(self, split: str) -> HandDataset:
        dataset = self._splits.dataset(split)
        if split != "train" or not self.recipe.exchanged:
            return dataset
        reading = self.recipe.reading
        return WithExchangedFingers(
            dataset, self.recipe.exchanged, reading.folder, workers=reading.workers
        )
