"""Lightning datamodule of images with 2D landmarks in shards (decision 98)."""

from typing import Any

from torch.utils.data import DataLoader

from hand_recon.data.dataset import HandDataset
from hand_recon.data.image_datamodule import LabelledImageDataModule
from hand_recon.data.shards.dataset import ShardedImages
from hand_recon.data.shards.order import Mixing, ShardShuffle
from hand_recon.data.shards.splits import ShardRecipe, ShardSplits, check_cache
from hand_recon.schema import HandSample


class ShardDataModule(LabelledImageDataModule):
    """Images with 2D landmarks in shards, local or behind a URL; without 3D, so scores are 2D only.

    With `order=all` a training sees the batches that it would see with the image files, bit for bit.
    """

    name = "landmarks"
    landmark_set = "knuckle"
    recipe_type = ShardRecipe

    def __init__(self, **options: Any) -> None:  # noqa: ANN401  # Those of `ImageDataModule`.
        """Store the settings; files are read on first use.

        Args:
            **options: Those of `ImageDataModule`, and fields of `ShardRecipe`.
        """
        super().__init__(**options)
        self._splits = ShardSplits(self.recipe, self.landmark_set)

    def train_dataloader(self) -> DataLoader[HandSample]:
        """Shuffled batches of equal size; fewer samples than one batch make a smaller batch."""
        dataset = self.dataset("train")
        if self.recipe.order != "shards" or not isinstance(dataset, ShardedImages):
            return super().train_dataloader()
        trainer = self.trainer
        dataset = dataset.reading_whole_shards(int(self.recipe.cache_gb * 1e9))
        # Of this split alone: validation and testing read ranges.
        self._datasets["train"] = dataset
        check_cache(dataset.rows, self.recipe, trainer.num_devices if trainer is not None else 1)
        processes = trainer.world_size if trainer is not None else 1
        mixing = Mixing(
            self.recipe.shards_at_once, self.recipe.streams or processes, self.batch_size
        )
        return self._training_loader(ShardShuffle(dataset.starts(), self.seed, mixing))

    @property
    def own_order(self) -> str | None:
        """`order=shards`, which only a training on these shards alone can follow; None with `order=all`."""
        return None if self.recipe.order == "all" else f"order={self.recipe.order}"

    def _split(self, split: str) -> HandDataset:
        return self._splits.dataset(split)
