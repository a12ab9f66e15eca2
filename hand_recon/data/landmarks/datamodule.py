"""Lightning datamodule of images with 2D landmarks only (Sec. 4.1)."""

from pathlib import Path
from typing import Any

from hand_recon.data.dataset import HandDataset
from hand_recon.data.image_datamodule import LabelledImageDataModule
from hand_recon.data.landmarks.exchanged import WithExchangedFingers
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits


class LandmarkDataModule(LabelledImageDataModule):
    """Images with 2D landmarks from COCO, JSON, CSV or HInt files; without 3D, so scores are 2D only."""

    name = "landmarks"
    landmark_set = "knuckle"
    recipe_type = LandmarkRecipe

    def __init__(self, *location: Path | str, **options: Any) -> None:  # noqa: ANN401  # Those of `ImageDataModule`.
        """Store the settings; files are read on first use.

        Args:
            *location: Landmarks of the training images, a file or a folder, unless given as `train`.
            **options: Those of `ImageDataModule`, and fields of `LandmarkRecipe`.
        """
        super().__init__(*location, **options)
        self._splits = LandmarkSplits(self.recipe)

    def _split(self, split: str) -> HandDataset:
        dataset = self._splits.dataset(split)
        if split != "train" or not self.recipe.exchanged:
            return dataset
        reading = self.recipe.reading
        return WithExchangedFingers(
            dataset, self.recipe.exchanged, reading.folder, workers=reading.workers
        )
