"""Writes a shard: images and their labels in a tar file, in WebDataset's layout, and its index (decision 98).

The image with number 12 is the member `000000012.jpg`, its labels are `000000012.json` before it. The same
input gives the same bytes: members have no times and no owners.
"""

import hashlib
import os
import tarfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from hand_recon.data.shards.index import BLOCK, INDEX, padded
from hand_recon.data.shards.manifest import Shard, ShardFile
from hand_recon.data.whole_files import replaced_when_whole

_END: Final = bytes(2 * BLOCK)
"""Two empty headers end a tar file."""


@dataclass(frozen=True)
class ShardImage:
    """An image with its labels, ready to be written."""

    number: int
    """Number of the image in the dataset, from 0: its name in the shard."""
    suffix: str
    """Suffix of the image's format, with the dot."""
    content: bytes
    """The encoded image."""
    labels: bytes
    """Labels of its hands (`labels_to_json`)."""
    groups: Sequence[int]
    """Group of each of its hands."""


def write_shard(folder: Path, name: str, images: Iterable[ShardImage]) -> Shard | None:
    """Write a shard and its index, each of which is there whole or not at all.

    Args:
        folder: Their folder.
        name: Name of the files without suffix.
        images: Images in order.

    Returns:
        The shard; None, and no files, without any image.
    """
    rows: list[tuple[int, int, int, int, int, int]] = []
    count = 0
    tar, index = folder / f"{name}.tar", folder / f"{name}.npy"
    with replaced_when_whole(tar) as unfinished, unfinished.open("wb") as stream:
        summed = _Summed(stream)
        for image in images:
            count += 1
            rows += _write_image(summed, image)
        summed.write(_END)
        stream.flush()
        os.fsync(stream.fileno())
    if not rows:
        tar.unlink()
        return None
    with replaced_when_whole(index) as unfinished, unfinished.open("wb") as stream:
        np.save(stream, np.array(rows, dtype=INDEX), allow_pickle=False)
    content = index.read_bytes()
    return Shard(
        tar=ShardFile(tar.name, summed.size, summed.digest.hexdigest()),
        index=ShardFile(index.name, len(content), hashlib.sha256(content).hexdigest()),
        images=count,
        hands=len(rows),
    )


class _Summed:
    """Stream that keeps the size and the SHA-256 of what was written."""

    def __init__(self, stream: BinaryIO) -> None:
        self.stream = stream
        self.size = 0
        self.digest = hashlib.sha256()

    def write(self, content: bytes) -> None:
        self.stream.write(content)
        self.digest.update(content)
        self.size += len(content)


def _write_image(stream: _Summed, image: ShardImage) -> list[tuple[int, int, int, int, int, int]]:
    """Write both members of an image; returns the rows of the index."""
    stem = f"{image.number:09d}"
    stream.write(_header(f"{stem}.json", len(image.labels)))
    offset = stream.size
    record = b"".join(
        [
            _filled(image.labels),
            _header(stem + image.suffix, len(image.content)),
            image.content,
        ]
    )
    stream.write(record)
    stream.write(bytes(padded(len(image.content)) - len(image.content)))
    sizes = (offset, len(image.labels), len(image.content), zlib.crc32(record))
    return [(*sizes, group, hand) for hand, group in enumerate(image.groups)]


def _header(name: str, size: int) -> bytes:
    info = tarfile.TarInfo(name)
    info.size = size
    return info.tobuf(tarfile.USTAR_FORMAT)


def _filled(content: bytes) -> bytes:
    return content + bytes(padded(len(content)) - len(content))
