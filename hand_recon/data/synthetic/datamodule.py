"""Data module of rendered hands (Sec. 4.1)."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch

from hand_recon.data.augment import Augmentation
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import HandDataset
from hand_recon.data.sample_order import SeededShuffle
from hand_recon.data.selection import evenly_spaced
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.schema import HandParameters


class SyntheticDataModule(HandDataModule):
    """Synthetic hands, rendered on first use and cached; they need no download or registration."""

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
        without: Sequence[str] | None = None,
        render_workers: int = 1,
        landmark_set: str = "knuckle",
        pictures: bool = True,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        data_seed: int = 0,
        keep: str = "disk",
    ) -> None:
        """Configure the three splits; images are rendered when a split is first used.

        Args:
            level: Level of difficulty, a key of `DIFFICULTIES`.
            train_size: Number of training images.
            val_size: Number of validation images.
            test_size: Number of test images; their gestures and shapes do not occur in training.
            crop_size: Side of an image, pixels.
            cache_dir: Folder for rendered images.
            without: Features that training images lack, keys of `FEATURES`.
            render_workers: Number of processes that render; with two or more, and without loading processes,
                a training begins with the first images while others are rendered.
            landmark_set: The hand's landmark set.
            pictures: True renders images; False gives landmarks only, in crops of 224 pixels.
            batch_size: Hands per batch and process.
            workers: Number of loading processes.
            augmentation: Augmentation of training batches.
            seed: Seed of the order of samples and of the augmentation.
            data_seed: Seed of the images, the same for all seeds of a study.
            keep: Place of the samples of training and validation: `disk`, `memory` or `device`; but for
                `disk`, a training begins when all images are rendered.
        """
        self.landmark_set = landmark_set
        self.name = "synthetic" if pictures else "views"
        self._split = partial(
            SyntheticHands,
            crop_size=crop_size,
            level=level,
            seed=data_seed,
            cache_dir=Path(cache_dir),
            workers=render_workers,
            landmark_set=landmark_set,
            pictures=pictures,
        )
        self._train_size = train_size
        self._train = partial(self._split, split="train", without=tuple(without or ()))
        # Loading processes have no part in what a thread of this process renders: they get complete sets.
        self._ahead = workers == 0
        super().__init__(
            self._train_ahead,
            partial(
                self._split,
                split="val",
                size=val_size,
                order=range(val_size) if self._ahead else None,
            ),
            partial(self._split, split="test", size=test_size),
            crop_size=crop_size,
            batch_size=batch_size,
            workers=workers,
            augmentation=augmentation,
            seed=seed,
            keep=keep,
        )

    def _train_ahead(self) -> HandDataset:
        """Training set, rendered in the order of the first epoch."""
        size = range(self._train_size)
        order = SeededShuffle(size, self.seed).order() if self._ahead else None
        return self._train(size=self._train_size, order=order)

    def ground_truth_dataset(self) -> HandDataset:
        """Training set with vertices."""
        return self._train(size=self._train_size, with_vertices=True)

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """Split with vertices; all splits except training have them by default."""
        return self.ground_truth_dataset() if split == "train" else self.dataset(split)

    def train_parameters(self, limit: int | None = None) -> HandParameters:
        """Hand parameters of the training images, spread evenly over the set."""
        hands = self._train(size=self._train_size)
        return hands.parameters(torch.tensor(evenly_spaced(len(hands), limit or len(hands))))
