"""Dataset in memory: every sample is read once, and batches are picked on the device that holds them.

A batch then costs one selection for each of its fields in place of one read for each of its samples, and
nothing has to be copied to an accelerator.
"""

import logging
from dataclasses import fields
from typing import Any, Final

import torch
from torch import Tensor

from hand_recon.data.copies import copied
from hand_recon.data.dataset import HandDataset, load_batch
from hand_recon.data.free_memory import free_memory
from hand_recon.data.progress import with_progress
from hand_recon.schema import HandBatch, HandSample

logger = logging.getLogger(__name__)

PLACES: Final = {
    "disk": "read anew at each step, from the caches",
    "memory": "read once into main memory",
    "device": "read once into the memory of the training device",
}
"""Places of the samples of training and validation."""

_AT_ONCE: Final = 256
"""Samples that are read at once."""

_IF_ALL: Final = ("intrinsics", "occluded")
"""Fields that a batch has only if all of its samples have them; it has others if any has them."""
_SHARE: Final = 0.8
"""Largest share of the free memory that samples may take."""


class ResidentDataset:
    """All samples of a dataset in the memory of a device; its batches equal the dataset's.

    They do so bit for bit, but for posed surfaces, whose last digits depend on the hands that are posed
    together: here each is posed alone.
    """

    def __init__(
        self, dataset: HandDataset, device: torch.device, name: str, *, processes: int = 1
    ) -> None:
        """Read the whole dataset.

        Args:
            dataset: Dataset to read; a damaged image is replaced now as it would be at each step.
            device: Device that holds the samples.
            name: Name for messages.
            processes: Number of processes of this machine that each read the whole dataset.

        Raises:
            MemoryError: The device has too little memory left.
        """
        self.dataset = dataset
        self.device = device
        self._columns: dict[str, Tensor] = {}
        self._present: dict[str, Tensor] = {}
        self._sources: list[str] = []
        chunks = torch.arange(len(dataset)).split(_AT_ONCE)
        for chunk in with_progress(chunks, len(chunks), f"Reading {name} into memory"):
            # Each sample as a batch of one, with the fields that it has itself.
            pieces = [load_batch(dataset, [index]) for index in chunk.tolist()]
            if not self._columns:
                _check_room(
                    len(dataset) * _size(pieces[0]),
                    device,
                    f"{len(dataset)} samples of {name}",
                    processes,
                )
            self._add(chunk, pieces)
        size = sum(column.nbytes for column in self._columns.values())
        logger.info(
            "%d samples of %s are kept on %s: %.2f GB.", len(self), name, device, size / 1e9
        )

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: int) -> HandSample:
        """One sample, as the dataset reads it."""
        return self.dataset[index]

    def batch(self, indices: list[int], /) -> HandBatch:
        """Several samples on the device.

        Args:
            indices: Positions in the dataset.
        """
        chosen = torch.tensor(indices)
        there = copied(chosen, self.device)
        columns: dict[str, Any] = {
            name: column.index_select(0, there)
            for name, column in self._columns.items()
            if self._is_in_batch(name, chosen)
        }
        return HandBatch(source=tuple(self._sources[index] for index in indices), **columns)

    def _is_in_batch(self, name: str, chosen: Tensor) -> bool:
        """True if `collate` would give these samples the field; the flags are in main memory."""
        present = self._present[name][chosen]
        return bool(present.all() if name in _IF_ALL else present.any())

    def _add(self, chunk: Tensor, pieces: list[HandBatch]) -> None:
        """Store some samples that follow each other."""
        for piece in pieces:
            self._sources += piece.source
        for field in fields(HandBatch):
            values = [getattr(piece, field.name) for piece in pieces]
            like = next((value for value in values if isinstance(value, Tensor)), None)
            if like is None:
                continue
            column = self._column(field.name, like)
            missing = like.new_full(like.shape, _missing(like))
            joined = torch.cat([missing if value is None else value for value in values])
            column[chunk[0] : chunk[-1] + 1] = joined.to(self.device)
            flags = torch.tensor([value is not None for value in values])
            self._present[field.name][chunk] = flags

    def _column(self, name: str, like: Tensor) -> Tensor:
        """Values of a field of all samples, and flags of those that have it."""
        if name not in self._columns:
            shape = (len(self), *like.shape[1:])
            self._columns[name] = torch.full(
                shape, _missing(like), dtype=like.dtype, device=self.device
            )
            self._present[name] = torch.zeros(len(self), dtype=torch.bool)
        return self._columns[name]


def _missing(like: Tensor) -> float:
    """Value of a field where a sample lacks it: NaN, or zero for bytes and flags."""
    return torch.nan if like.is_floating_point() else 0


def _size(samples: HandBatch) -> int:
    """Bytes of a batch."""
    values = [getattr(samples, field.name) for field in fields(samples)]
    return sum(value.nbytes for value in values if isinstance(value, Tensor))


def _check_room(needed: int, device: torch.device, what: str, processes: int) -> None:
    """Compare what samples take with what is free.

    Raises:
        MemoryError: They take more.
    """
    together, of = needed, ""
    if device.type == "cpu":
        # Processes share the memory of their machine; each has a GPU of its own.
        together, of = needed * processes, f", in each of {processes} processes" * (processes > 1)
    free = free_memory(device)
    if free is not None and together > _SHARE * free:
        other = "" if device.type == "cpu" else ", or data.keep=memory"
        raise MemoryError(
            f"The {what} take {needed / 1e9:.1f} GB in the memory of {device}{of}, and {free / 1e9:.1f} GB "
            f"are free, of which at most {_SHARE:.0%} are used. Set data.keep=disk{other}, a smaller "
            "crop_size, or fewer samples."
        )


def check_place(keep: str) -> None:
    """Refuse a word that is not in `PLACES`.

    Raises:
        ValueError: It is not.
    """
    if keep not in PLACES:
        choices = "; ".join(f"{name} ({meaning})" for name, meaning in PLACES.items())
        raise ValueError(f"Found data.keep={keep}; expected one of {choices}.")
