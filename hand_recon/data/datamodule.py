"""Base class of all datamodules: loaders, sample order, threads, augmentation on the device (Sec. 4.1)."""

import logging
import zlib
from typing import Any

import lightning
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import DataLoader

from hand_recon.data.augment import Augmentation, to_float
from hand_recon.data.dataset import (
    BatchedDataset,
    Batches,
    DatasetFactory,
    HandDataset,
    load_batch,
    stacked,
)
from hand_recon.data.resident import ResidentDataset, check_place
from hand_recon.data.sample_order import (
    DealtOut,
    EpochSampler,
    EvaluationShare,
    ResumableLoader,
    SeededShuffle,
    limit_threads,
)
from hand_recon.data.selection import evenly_spaced
from hand_recon.processes import process_group
from hand_recon.schema import HandBatch, HandParameters, HandSample

logger = logging.getLogger(__name__)


class HandDataModule(lightning.LightningDataModule):
    """Loaders of crops for training, validation and test, built only when a stage needs them."""

    name = "hands"
    """Name of this dataset in reports."""
    landmark_set = "knuckle"
    """The hand model's landmark set that this dataset's labels follow."""

    def __init__(
        self,
        train: DatasetFactory,
        val: DatasetFactory,
        test: DatasetFactory,
        *,
        crop_size: int,
        batch_size: int = 64,
        workers: int = 0,
        augmentation: Augmentation | None = None,
        seed: int = 0,
        keep: str = "disk",
    ) -> None:
        """Store the settings; datasets are built on first use.

        Args:
            train: Builds the training set.
            val: Builds the validation set.
            test: Builds the test set.
            crop_size: Side of the square crops that they give, pixels.
            batch_size: Hands per batch and process.
            workers: Loading processes; zero loads in the training process.
            augmentation: Applied to training batches on the training device; None turns it off.
            seed: Seed of the sample order and of the augmentation.
            keep: Place of the samples of training and validation, a word of `PLACES`.

        Raises:
            ValueError: The batch size is below 1, the number of workers is negative, or the place is unknown.
        """
        super().__init__()
        check_place(keep)
        if batch_size < 1 or workers < 0:
            raise ValueError(
                f"batch_size={batch_size} must be at least 1 and workers={workers} at least 0."
            )
        self.crop_size = crop_size
        self.batch_size = batch_size
        self.workers = workers
        self.augmentation = augmentation
        self.seed = seed
        self.keep = keep
        self._factories = {"train": train, "val": val, "test": test}
        self._datasets: dict[str, HandDataset] = {}
        self._resident: dict[str, ResidentDataset] = {}

    @property
    def own_order(self) -> str | None:
        """Option by which training hands come in an order that a mixture cannot keep; None without one."""
        return None

    def prepare_data(self) -> None:
        """Build the next datasets in one process per machine, so that the others find its caches."""
        function = self.trainer.state.fn if self.trainer is not None else None
        self.setup(str(function.value) if function is not None else None)

    def setup(self, stage: str | None = None) -> None:
        """Build the datasets of a stage that are not built yet.

        Args:
            stage: `fit`, `validate`, `test` or `predict` (the test set); none builds everything.
        """
        needed = {
            "fit": ("train", "val"),
            "validate": ("val",),
            "test": ("test",),
            "predict": ("test",),
        }
        for split in needed.get(stage or "all", tuple(self._factories)):
            self.dataset(split)

    def dataset(self, split: str) -> HandDataset:
        """The dataset of a split, built on first use.

        Raises:
            ValueError: The split is unknown, or has no samples.
        """
        if split not in self._factories:
            raise ValueError(f"Unknown split {split!r}; the splits are {sorted(self._factories)}.")
        if split not in self._datasets:
            dataset = self._factories[split]()
            if len(dataset) == 0:
                raise ValueError(
                    f"The {split} split of {self.name} is empty; give it more samples, or a larger "
                    "share of them."
                )
            self._datasets[split] = dataset
        return self._datasets[split]

    def train_dataloader(self) -> DataLoader[HandSample]:
        """Shuffled batches of equal size; fewer samples than one batch make a smaller batch."""
        return self._training_loader(SeededShuffle(self.dataset("train"), self.seed))

    def _training_loader(self, sampler: EpochSampler) -> DataLoader[HandSample]:
        """Batches in a sampler's order, dealt out to all processes.

        Args:
            sampler: Order of all samples of an epoch.

        Raises:
            ValueError: There are fewer samples than processes.
        """
        samples, processes = len(sampler), process_group.count()
        batch_size = min(self.batch_size, samples // processes)
        if batch_size == 0:
            raise ValueError(
                f"An epoch of {self.name} has {samples} training samples for {processes} processes, and each "
                "needs one. Lower trainer.devices, or give more samples."
            )
        if batch_size < self.batch_size:
            logger.warning(
                "An epoch of %s has %d training samples, fewer than batch_size=%d in each process: batches "
                "have %d instead.",
                self.name, samples, self.batch_size, batch_size,
            )  # fmt: skip
        if processes > 1:
            sampler = DealtOut(sampler, batch_size, process_group.rank(), processes)
        return self._loader("train", batch_size, sampler=sampler, drop_last=True)

    def val_dataloader(self) -> DataLoader[HandSample]:
        """Validation batches in order."""
        return self._loader("val", self.batch_size)

    def test_dataloader(self) -> DataLoader[HandSample]:
        """Test batches in order."""
        return self._loader("test", self.batch_size)

    def predict_dataloader(self) -> DataLoader[HandSample]:
        """Test batches in order."""
        return self.test_dataloader()

    def transfer_batch_to_device(
        self, batch: HandBatch, device: torch.device, dataloader_idx: int
    ) -> HandBatch:
        """Copy a batch to a device; from page-locked memory, a GPU is not waited for."""
        del dataloader_idx
        return batch.to(device, non_blocking=device.type == "cuda")

    def on_after_batch_transfer(self, batch: HandBatch, dataloader_idx: int) -> HandBatch:
        """Convert the image to floats 0–1 and, in training, augment on the training device."""
        del dataloader_idx
        trainer = self.trainer
        if self.augmentation is None or trainer is None or not trainer.training:
            return to_float(batch)
        # The draws depend on the step, not on earlier draws: a resumed run sees the same images.
        key = (self.seed, trainer.global_rank, trainer.fit_loop.total_batch_idx)
        generator = torch.Generator().manual_seed(zlib.crc32(repr(key).encode()))
        return self.augmentation(batch, generator)

    def train_ground_truth(
        self, limit: int | None = None
    ) -> (
        tuple[Float[Tensor, "sample landmark=21 3"], Float[Tensor, "sample vertex 3"] | None] | None
    ):
        """3D landmarks and vertices of the training set, for baselines only; training never uses them.

        Args:
            limit: At most so many samples, spread evenly over the set.

        Returns:
            Landmarks and, where there are any, vertices, in the camera's frame, metres; None where
            the dataset has no 3D.
        """
        dataset = self.ground_truth_dataset()
        batch = load_batch(dataset, evenly_spaced(len(dataset), limit or len(dataset)))
        if batch.landmarks_3d is None:
            return None
        return batch.landmarks_3d, batch.vertices

    def train_parameters(self, limit: int | None = None) -> HandParameters | None:
        """Pose and shape of the training hands, used only by priors that are learnt from 3D.

        Args:
            limit: At most so many hands, spread evenly over the set.

        Returns:
            None where the dataset has none.
        """
        del limit
        return None

    def ground_truth_dataset(self) -> HandDataset:
        """The training set, with vertices where they are cheap to read."""
        return self.dataset("train")

    def dataset_with_surfaces(self, split: str) -> HandDataset:
        """The dataset of a split with its surfaces, where there are any: for inspection, not for training."""
        return self.dataset(split)

    def _loader(
        self,
        split: str,
        batch_size: int,
        *,
        sampler: EpochSampler | None = None,
        drop_last: bool = False,
    ) -> DataLoader[HandSample]:
        dataset = self.dataset(split) if split == "test" else self._where_kept(split)
        # Nothing is left to be loaded where samples are in memory, and nothing to be pinned on a device.
        place = dataset.device.type if isinstance(dataset, ResidentDataset) else None
        workers = self.workers if place is None else 0
        loader: type[DataLoader[HandSample]] = DataLoader if sampler is None else ResumableLoader
        rank, processes = process_group.rank(), process_group.count()
        batches: dict[str, Any] = {
            "batch_size": batch_size, "sampler": sampler, "drop_last": drop_last,
        }  # fmt: skip
        if sampler is None and processes > 1:
            batches = {"batch_sampler": EvaluationShare(len(dataset), batch_size, rank, processes)}
        # The seeds of loading processes differ between processes of a training, too.
        seeds = torch.Generator().manual_seed(zlib.crc32(repr((self.seed, rank)).encode()))
        return loader(
            Batches(dataset) if isinstance(dataset, BatchedDataset) else dataset,  # type: ignore[arg-type]  # any sized, indexable object will do
            **batches,
            num_workers=workers,
            persistent_workers=workers > 0,
            pin_memory=torch.cuda.is_available() and place in (None, "cpu"),
            collate_fn=stacked,
            worker_init_fn=limit_threads,
            generator=seeds if rank else None,
        )

    def _where_kept(self, split: str) -> HandDataset:
        """The dataset of a split, or its samples in memory (without a trainer: main memory), read once."""
        if self.keep == "disk":
            return self.dataset(split)
        device, processes = torch.device("cpu"), 1
        if self.trainer is not None:
            processes = self.trainer.num_devices
            if self.keep == "device":
                device = self.trainer.strategy.root_device
        if split in self._resident and self._resident[split].device != device:
            # Given up before the new one takes its place.
            del self._resident[split]
        if split not in self._resident:
            name = f"the {split} split of {self.name}"
            self._resident[split] = ResidentDataset(
                self.dataset(split), device, name, processes=processes
            )
        return self._resident[split]
