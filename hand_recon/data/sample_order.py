"""Order of training samples: a function of seed, epoch and batch, so that any batch can be the first."""

import zlib
from abc import abstractmethod
from collections.abc import Iterator, Sized
from typing import Any

import torch
from torch.utils.data import DataLoader, Sampler

from hand_recon.schema import HandSample


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
        # A sampler that deals an epoch out to several processes cannot skip: its batches are passed over.
        for number, batch in enumerate(batches, start=first if skips else 0):
            if number >= first:
                self._given = (epoch, number + 1)
                yield batch

    def state_dict(self) -> dict[str, int]:
        """The epoch and its batches so far: none before an epoch's first."""
        epoch = self._epoch()
        return {"epoch": epoch, "batches": self._given[1] if self._given[0] == epoch else 0}

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
