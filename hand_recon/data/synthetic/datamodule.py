"""Rendered hands for Lightning (Sec. 4.1)."""

from functools import partial
from pathlib import Path

import torch

from hand_recon.data.augment import Augmentation
from hand_recon.data.datamodule import HandDataModule, HandDataset
from hand_recon.data.selection import evenly_spaced
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.schema import HandParameters


class SyntheticDataModule(HandDataModule):
    """Rendered hands, made on first use: no files, no registration."""

    name = "synthetic"

    def __init__(
        self,
        level: str = "easy",
        *,
        train_size: int,
        val_size: int,
        test_size: int,
        crop_size: int,
        cache_dir: Path | str,
        render_workers: int = 1,
        landmarks: str = "knuckle",
        pictures: bool = True,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        data_seed: int = 0,
    ) -> None:
        """Remember what to render.

        Args:
            level: How hard the pictures are.
            train_size: Number of training pictures.
            val_size: Number of validation pictures.
            test_size: Number of test pictures, of gestures and shapes that training never shows.
            crop_size: Side of a picture, pixels.
            cache_dir: Where rendered pictures are kept.
            render_workers: Processes that render.
            landmarks: The hand's landmark set.
            pictures: Whether there are pictures, or landmarks alone, in crops of 224 pixels.
            batch_size: Hands per batch and process.
            workers: Loading processes.
            augmentation: Applied to training batches.
            seed: Fixes the order of samples and the augmentation.
            data_seed: Fixes the pictures: the same for all seeds of a study.
        """
        self.landmarks = landmarks
        self.name = "synthetic" if pictures else "views"
        self._split = partial(
            SyntheticHands,
            crop_size=crop_size,
            level=level,
            seed=data_seed,
            cache_dir=Path(cache_dir),
            workers=render_workers,
            landmarks=landmarks,
            pictures=pictures,
        )
        self._train_size = train_size
        super().__init__(
            partial(self._split, split="train", size=train_size),
            partial(self._split, split="val", size=val_size),
            partial(self._split, split="test", size=test_size),
            crop_size=crop_size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
        )

    def ground_truth_dataset(self) -> HandDataset:
        """The training pictures, with their surfaces."""
        return self._split(split="train", size=self._train_size, with_vertices=True)

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """All splits but training have them anyway."""
        return self.ground_truth_dataset() if split == "train" else self.dataset(split)

    def train_parameters(self, limit: int | None = None) -> HandParameters:
        """What made the training pictures."""
        hands = self._split(split="train", size=self._train_size)
        return hands.parameters(torch.tensor(evenly_spaced(len(hands), limit or len(hands))))
