"""Order of training samples: a function of seed, epoch and batch, so that any batch can be the first."""

import zlib
from abc import abstractmethod
from collections.abc import Iterator, Sized
from typing import Any, Final

import torch
from torch.utils.data import DataLoader, Sampler

from hand_recon.processes import process_group
from hand_recon.schema import HandSample

PROCESSES: Final = "processes"
"""Key of the number of processes in the state of a loader; without it, it is 1."""


class EpochSampler(Sampler[int]):
    """Sampler whose order depends only on the seed and the epoch, so that a run can be resumed."""

    def __init__(self, seed: int) -> None:
        """Start with the first epoch."""
        self.seed = seed
        self.epoch = 0
        self.skipped = 0

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch; Lightning calls this at the start of each epoch."""
        self.epoch = epoch

    def generator(self) -> torch.Generator:
        """Random number generator of this epoch."""
        key = repr((self.seed, self.epoch)).encode()
        return torch.Generator().manual_seed(zlib.crc32(key))

    @abstractmethod
    def order(self) -> list[int]:
        """Indices of all samples of this epoch."""

    @abstractmethod
    def __len__(self) -> int:
        """Number of samples of an epoch."""

    def __iter__(self) -> Iterator[int]:
        """Indices of this epoch, without the first `skipped` ones."""
        yield from self.order()[self.skipped :]


class SeededShuffle(EpochSampler):
    """All samples of a dataset, in a new order in each epoch."""

    def __init__(self, dataset: Sized, seed: int) -> None:
        """Shuffle the indices of `dataset`."""
        super().__init__(seed)
        self.dataset = dataset

    def order(self) -> list[int]:
        """A permutation of all indices."""
        return list(torch.randperm(len(self.dataset), generator=self.generator()).tolist())

    def __len__(self) -> int:
        return len(self.dataset)


class DealtOut(EpochSampler):
    """Share of one process in an order of samples: its part of each batch of all processes.

    The hands of a step are those of one process with a batch as large as all batches together. Samples
    that do not fill such a batch are left out until the next epoch, as those of an incomplete batch are.
    """

    def __init__(self, whole: EpochSampler, batch_size: int, process: int, processes: int) -> None:
        """Deal out an order.

        Args:
            whole: Order of all samples.
            batch_size: Samples of a batch of one process.
            process: Number of this process, from 0.
            processes: Number of all processes.
        """
        super().__init__(whole.seed)
        self.whole = whole
        self.batch_size, self.process, self.processes = batch_size, process, processes

    def set_epoch(self, epoch: int) -> None:
        """Set the epoch of the whole order, too."""
        super().set_epoch(epoch)
        self.whole.set_epoch(epoch)

    def order(self) -> list[int]:
        """Indices of this process's samples in this epoch."""
        step = self.batch_size * self.processes
        order = self.whole.order()
        first = self.batch_size * self.process
        starts = range(first, len(order) // step * step, step)
        return [index for start in starts for index in order[start : start + self.batch_size]]

    def __len__(self) -> int:
        step = self.batch_size * self.processes
        return len(self.whole) // step * self.batch_size


class EvaluationShare(Sampler[list[int]]):
    """Batches of one process in an evaluation: each sample in one process, once, and as many batches in each.

    Processes that exchange something in each batch, such as the state of batch normalization, would wait for
    each other for ever with different numbers of batches. So the sizes of batches differ by one instead.
    """

    def __init__(self, size: int, batch_size: int, process: int, processes: int) -> None:
        """Deal out the samples.

        Args:
            size: Number of all samples.
            batch_size: Samples of a batch; with 1, a process with a sample more has a batch of two.
            process: Number of this process, from 0.
            processes: Number of all processes.

        Raises:
            ValueError: There are fewer samples than processes.
        """
        if size < processes:
            raise ValueError(
                f"An evaluation of {size} hands cannot be shared by {processes} processes: each needs one. "
                "Lower trainer.devices, or give more hands."
            )
        most = -(-size // processes)
        number = min(-(-most // batch_size), size // processes)
        parts = torch.arange(process, size, processes).tensor_split(number)
        self.batches: list[list[int]] = [part.tolist() for part in parts]

    def __iter__(self) -> Iterator[list[int]]:
        """Indices of each batch."""
        yield from self.batches

    def __len__(self) -> int:
        return len(self.batches)


class ResumableLoader(DataLoader[HandSample]):
    """Loader of training batches whose state is the epoch and the number of batches that it gave.

    With the state of a checkpoint, it begins at the next batch; the batches before it are not loaded. Nothing
    is loaded before the first batch is asked for, when the epoch is known.
    """

    _given = (-1, 0)
    _resumed = (-1, 0)

    def __iter__(self) -> Iterator[Any]:  # type: ignore[override]  # Lightning needs no more
        """Batches of the sampler's epoch, from the resumed one on."""
        epoch = self._epoch()
        first = self._resumed[1] if self._resumed[0] == epoch else 0
        sampler = self.sampler
        skips = isinstance(sampler, EpochSampler)
        if isinstance(sampler, EpochSampler):
            sampler.skipped = first * (self.batch_size or 1)
        batches = super().__iter__()
        # Another sampler, such as that of debug=overfit, cannot skip: its batches are passed over.
        for number, batch in enumerate(batches, start=first if skips else 0):
            if number >= first:
                self._given = (epoch, number + 1)
                yield batch

    def state_dict(self) -> dict[str, int]:
        """The epoch, its batches so far, none before an epoch's first, and the processes that share it."""
        epoch = self._epoch()
        batches = self._given[1] if self._given[0] == epoch else 0
        return {"epoch": epoch, "batches": batches, PROCESSES: process_group.count()}

    def load_state_dict(self, state: dict[str, int]) -> None:
        """Begin that epoch after those batches."""
        self._resumed = self._given = (state["epoch"], state["batches"])

    def _epoch(self) -> int:
        return int(getattr(self.sampler, "epoch", 0))


def limit_threads(worker: int) -> None:
    """Limit each loading process to one thread: more threads than cores are slower."""
    # Imported here, so that a training from decoded images needs no OpenCV.
    import cv2

    del worker
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
