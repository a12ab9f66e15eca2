"""Interface of datasets, and batches of their samples."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from hand_recon.schema import HandBatch, HandSample, collate


@runtime_checkable
class HandDataset(Protocol):
    """Interface of a dataset; any map-style `Dataset[HandSample]` has it."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> HandSample: ...


@runtime_checkable
class BatchedDataset(HandDataset, Protocol):
    """A dataset that makes whole batches itself, which is many times faster for small samples."""

    def batch(self, indices: list[int], /) -> HandBatch:
        """Several samples, stacked as `collate` would."""
        ...


DatasetFactory = Callable[[], HandDataset]
"""Function that builds a dataset when it is first needed: a class or function with its arguments bound."""


class Batches:
    """Adapter of a `BatchedDataset` to `__getitems__`, by which a loader fetches a whole batch."""

    def __init__(self, dataset: BatchedDataset) -> None:
        self.dataset = dataset

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: int) -> HandSample:
        return self.dataset[index]

    def __getitems__(self, indices: list[int]) -> HandBatch:
        return self.dataset.batch(indices)


def load_batch(dataset: HandDataset, indices: list[int]) -> HandBatch:
    """Load some samples of a dataset as one batch.

    Args:
        dataset: Dataset to read.
        indices: Positions in the dataset.
    """
    if isinstance(dataset, BatchedDataset):
        return dataset.batch(indices)
    return collate([dataset[index] for index in indices])


def stacked(samples: list[HandSample] | HandBatch) -> HandBatch:
    """Batch of samples, or the batch itself that a `BatchedDataset` has made: a loader's `collate_fn`."""
    return samples if isinstance(samples, HandBatch) else collate(samples)
