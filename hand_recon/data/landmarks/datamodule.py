"""Images of hands with 2D landmarks alone for Lightning (Sec. 4.1)."""

from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from hand_recon.data.crop import CropPolicy
from hand_recon.data.datamodule import HandDataset
from hand_recon.data.image_datamodule import ImageDataModule
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits


class LandmarkDataModule(ImageDataModule):
    """Anybody's images: COCO keypoints, JSON, CSV or HInt; no 3D, so its scores are 2D ones."""

    name = "landmarks"
    landmarks = "knuckle"
    recipe_type = LandmarkRecipe
    default_crop = CropPolicy(around="joints")

    def __init__(self, *location: Path | str, **options: Any) -> None:  # noqa: ANN401  # Those of `ImageDataModule`.
        """Remember what to read.

        Args:
            *location: Landmarks of the training images, a file or a folder, unless given as `train`.
            **options: Those of `ImageDataModule`, and fields of `LandmarkRecipe`.
        """
        super().__init__(*location, **options)
        self._splits = LandmarkSplits(self.recipe)

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """The split: there are no surfaces."""
        return self.dataset(split)

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """None: there is no 3D, and no image has to be read to know it."""
        del limit
        return None

    def _split(self, split: str) -> HandDataset:
        return self._splits.dataset(split)
