"""Index of a shard: the place of each hand's image and labels in the tar file, as an array (decision 98).

A hand's record is one range of bytes: its labels, the image's header and the image. No name inside the tar
file is looked at, so that none can lead elsewhere.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.shards.open_files import OpenFiles
from hand_recon.reading.archives import load_array
from hand_recon.reading.text import read_bytes

BLOCK: Final = 512
"""Bytes of a tar file's header, of which members are multiples."""

INDEX: Final = np.dtype(
    [
        ("offset", "<u8"),
        ("labels", "<u4"),
        ("image", "<u4"),
        ("sum", "<u4"),
        ("group", "<u4"),
        ("hand", "<u2"),
    ]
)
"""A row per hand: first byte of the record, bytes of labels and image, CRC-32 of the record, number of the
group of images that stay in one split, and number of the hand in its image."""

LARGEST_LABELS: Final = 1 << 20
"""Most bytes of the labels of one image."""

LARGEST_IMAGE: Final = 1 << 26
"""Most bytes of one image: 64 MiB."""


def padded(size: int) -> int:
    """Bytes that a member of some size takes in a tar file, without its header."""
    return -(-size // BLOCK) * BLOCK


def record_size(row: Any) -> int:  # noqa: ANN401  # a row or all rows of an index
    """Bytes of the record of a row of an index."""
    return padded(int(row["labels"])) + BLOCK + int(row["image"])


@dataclass(frozen=True)
class ShardIndex:
    """An index on the disk, of which nothing stays in memory; a loading process gets its path alone."""

    path: Path
    """The file."""
    hands: int
    """Number of rows."""
    start: int
    """First byte of the rows."""
    files: OpenFiles
    """Reader of the file."""

    def __len__(self) -> int:
        return self.hands

    def row(self, number: int) -> np.void:
        """One row, read from the disk.

        Raises:
            ValueError: The file has become shorter.
        """
        offset = self.start + number * INDEX.itemsize
        found = self.files.read(self.path, INDEX.itemsize, offset)
        if len(found) != INDEX.itemsize:
            raise ValueError(f"{self.path} ends before its row {number}. {CURE}")
        row: np.void = np.frombuffer(found, INDEX)[0]
        return row

    def rows(self) -> np.ndarray:
        """All rows, read anew on each call."""
        return _array(self.path, self.hands)


def open_index(
    path: Path, hands: int, shard_bytes: int, files: OpenFiles | None = None
) -> ShardIndex:
    """Read an index and check that its records lie inside the shard.

    Args:
        path: The file.
        hands: Number of hands that it must have.
        shard_bytes: Size of the tar file.
        files: Reader of its rows later on; None makes one.

    Raises:
        ValueError: It is no index of this shard.
    """
    index = _array(path, hands)
    labels, image = index["labels"].astype(np.uint64), index["image"].astype(np.uint64)
    ends = index["offset"] + (labels + (BLOCK - 1)) // BLOCK * BLOCK + BLOCK + image
    inside = (index["offset"] <= shard_bytes) & (ends <= shard_bytes)
    small = (labels <= LARGEST_LABELS) & (image <= LARGEST_IMAGE)
    if not (inside & small).all():
        raise ValueError(
            f"{path} has {int((~(inside & small)).sum())} records beyond the shard's {shard_bytes} bytes, "
            f"or beyond {LARGEST_IMAGE >> 20} MiB. {CURE}"
        )
    return ShardIndex(path, hands, path.stat().st_size - index.nbytes, files or OpenFiles())


def _array(path: Path, hands: int) -> np.ndarray:
    """Rows of an index.

    Raises:
        ValueError: It has other columns or another number of hands.
    """
    index = load_array(read_bytes(path), path)
    if index.dtype != INDEX or index.shape != (hands,):
        raise ValueError(
            f"{path} holds {index.shape} rows of {index.dtype}; expected {hands} hands of {INDEX}. {CURE}"
        )
    return index


CURE: Final = "Copy or download the shards again, or make them anew with hand-recon prepare shards."
"""Advice on damaged shards, for messages."""
