"""Dataset of hands in shards; one sample is read by one range of bytes (decision 98)."""

import copy
import logging
import zlib
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from hand_recon.data.annotated_dataset import to_sample
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import cut_crop
from hand_recon.data.images import CorruptImages, decode_image
from hand_recon.data.shards.index import BLOCK, CURE, padded, record_size
from hand_recon.data.shards.labels import labels_from_json
from hand_recon.data.shards.stores import ShardStore, Span
from hand_recon.schema import HandBatch, HandSample, collate

logger = logging.getLogger(__name__)


class ShardRows:
    """All hands of some manifests, in order, with the place of each."""

    def __init__(self, stores: Sequence[ShardStore]) -> None:
        """Open the indices.

        Args:
            stores: The manifests' places.
        """
        self.stores = list(stores)
        self.places = [
            (number, shard)
            for number, store in enumerate(self.stores)
            for shard in range(len(store.manifest.shards))
        ]
        self.indices = [self.stores[number].index(shard) for number, shard in self.places]
        self.starts = np.cumsum([0, *(len(index) for index in self.indices)])

    def __len__(self) -> int:
        return int(self.starts[-1])

    def groups(self) -> Int[np.ndarray, " row"]:
        """Group of each hand; those of different manifests differ.

        Raises:
            ValueError: An index has a group beyond the number that its manifest gives.
        """
        firsts = np.cumsum([0, *(store.manifest.groups for store in self.stores)])
        found = []
        for (number, _), index in zip(self.places, self.indices, strict=True):
            store, groups = self.stores[number], index.rows()["group"]
            if int(groups.max()) >= store.manifest.groups:
                raise ValueError(
                    f"{store.where} has the group {groups.max()} in an index, and its manifest says that "
                    f"there are {store.manifest.groups} groups. {CURE}"
                )
            found.append(groups.astype(np.int64) + firsts[number])
        return np.concatenate(found)

    def read(self, rows: Sequence[int]) -> list[tuple[str, np.void, bytes]]:
        """Place in words, row of the index and record of some hands."""
        at = np.searchsorted(self.starts, rows, side="right") - 1
        found = [
            (self.places[one], self.indices[one].row(int(row - self.starts[one])))
            for one, row in zip(at.tolist(), rows, strict=True)
        ]
        records: list[bytes] = [b""] * len(rows)
        for number, store in enumerate(self.stores):
            mine = [turn for turn, ((owner, _), _) in enumerate(found) if owner == number]
            spans = [
                Span(found[turn][0][1], int(found[turn][1]["offset"]), record_size(found[turn][1]))
                for turn in mine
            ]
            for turn, record in zip(mine, store.read(spans), strict=True):
                records[turn] = record
        return [
            (self._place(place, int(row["offset"])), row, record)
            for (place, row), record in zip(found, records, strict=True)
        ]

    def whole(self, limit: int) -> "ShardRows":
        """The same hands, for which shards behind a URL are downloaded whole.

        Args:
            limit: Most bytes of downloaded shards that are kept.
        """
        rows = copy.copy(self)
        rows.stores = [store.whole(limit) for store in self.stores]
        return rows

    def _place(self, place: tuple[int, int], offset: int) -> str:
        store = self.stores[place[0]]
        return f"byte {offset} of {store.manifest.shards[place[1]].tar.name} in {store.where}"


class ShardedImages:
    """Dataset of some hands in shards, cropped and mirrored as those of files are.

    An image that cannot be read is skipped with a warning and replaced by the next readable one.
    """

    def __init__(
        self,
        rows: ShardRows,
        chosen: Int[np.ndarray, " row"] | None,
        crop: CropPolicy,
        max_corrupt: int,
    ) -> None:
        """Store the settings.

        Args:
            rows: All hands.
            chosen: Rows of this split, ascending; None for all.
            crop: Size and position of the crops; `box` where the index has boxes.
            max_corrupt: Number of damaged images that each loading process may skip.
        """
        self.rows = rows
        self.chosen = chosen
        self.crop = crop
        self.corrupt = CorruptImages(max_corrupt)

    def __len__(self) -> int:
        return len(self.rows) if self.chosen is None else len(self.chosen)

    def reading_whole_shards(self, limit: int) -> "ShardedImages":
        """The same hands, for which shards behind a URL are downloaded whole.

        Args:
            limit: Most bytes of downloaded shards that are kept.
        """
        dataset = copy.copy(self)
        dataset.rows = self.rows.whole(limit)
        return dataset

    def starts(self) -> Int[np.ndarray, " bound"]:
        """First position of each shard with hands of this split, and the number of positions."""
        starts = self.rows.starts
        return np.unique(starts if self.chosen is None else np.searchsorted(self.chosen, starts))

    def __getitem__(self, index: int) -> HandSample:
        """The sample at a position, or the next one with a readable image.

        Raises:
            IndexError: There is no such position.
            RuntimeError: Too many images cannot be read.
        """
        return self._samples([index])[0]

    def batch(self, indices: list[int]) -> HandBatch:
        """Several samples, whose records are asked for together.

        Raises:
            IndexError: There is no such position.
            RuntimeError: Too many images cannot be read.
        """
        return collate(self._samples(indices))

    def _samples(self, indices: Sequence[int]) -> list[HandSample]:
        for index in indices:
            if not 0 <= index < len(self):
                raise IndexError(f"Sample {index} of {len(self)}.")
        samples = self._read(indices)
        return [sample or self._next(index) for index, sample in zip(indices, samples, strict=True)]

    def _next(self, index: int) -> HandSample:
        for step in range(1, len(self)):
            sample = self._read([(index + step) % len(self)])[0]
            if sample is not None:
                return sample
        raise RuntimeError(
            f"No image of {[store.where for store in self.rows.stores]} can be read; copy or download the "
            "shards again."
        )

    def _read(self, positions: Sequence[int]) -> list[HandSample | None]:
        """Samples at some positions; None, with a warning, for one that cannot be read."""
        rows = [int(at if self.chosen is None else self.chosen[at]) for at in positions]
        samples: list[HandSample | None] = []
        for position, (place, row, record) in zip(positions, self.rows.read(rows), strict=True):
            try:
                samples.append(self._sample(position, row, record))
            except ValueError as error:
                samples.append(None)
                self.corrupt.add(f"the hand at {place} ({error})")
        return samples

    def _sample(self, position: int, row: np.void, record: bytes) -> HandSample:
        """Decode a record.

        Raises:
            ValueError: It is damaged.
        """
        if len(record) != record_size(row) or zlib.crc32(record) != row["sum"]:
            raise ValueError("its bytes have another checksum than the index")
        labels, number = int(row["labels"]), int(row["hand"])
        hands = labels_from_json(record[:labels], "shards")
        pixels = decode_image(record[padded(labels) + BLOCK :])
        if pixels is None or number >= len(hands):
            raise ValueError(f"the image of {hands.source(0)} cannot be decoded")
        return to_sample(hands, number, cut_crop(hands, number, pixels, self.crop), position)
