"""Zip archives and NumPy's files from elsewhere: sizes are checked before anything is unpacked.

Nothing is ever unpacked to the disk, so that names of members (`../../x`) can do nothing.
"""

import io
import math
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

import numpy as np

from hand_recon.reading.limits import LIMITS, too_large
from hand_recon.reading.naming import naming

MOST_MEMBERS: Final = 100_000
"""Members of an archive; the largest that hands come in have some hundreds."""

_SUFFIX: Final = ".npy"


@contextmanager
def opened_zip(source: Path | io.BytesIO, name: object) -> Iterator[zipfile.ZipFile]:
    """Open a zip archive; what is damaged in it becomes a ValueError that names it.

    Args:
        source: The file, or a stream of its bytes.
        name: Name for messages.

    Raises:
        ValueError: It is no whole archive, encrypted, packed by an unknown method, or has too many members.
    """
    with naming(name, "a whole zip archive"):
        try:
            with zipfile.ZipFile(source) as archive:
                if len(archive.filelist) > MOST_MEMBERS:
                    raise ValueError(f"it has {len(archive.filelist)} members")
                yield archive
        except RuntimeError as error:
            # zipfile's error for a member with a password; RecursionError and others are subclasses.
            if "password" not in str(error):
                raise
            raise ValueError(f"it is encrypted ({error})") from error


def refuse_packed(path: Path) -> None:
    """Refuse a checkpoint whose members are compressed, which PyTorch never writes: a bomb may be in them.

    Args:
        path: The file; one that is no zip archive passes.

    Raises:
        ValueError: A member is compressed, or the members are larger than the file.
    """
    if not zipfile.is_zipfile(path):
        return
    with opened_zip(path, path) as archive:
        packed = [one for one in archive.infolist() if one.compress_type != zipfile.ZIP_STORED]
        size = sum(one.file_size for one in archive.infolist())
    if packed or size > path.stat().st_size:
        raise ValueError(
            f"{path} is packed: it unpacks to {size:,} bytes. PyTorch writes checkpoints without "
            "compression; take the original file."
        )


def load_array(content: bytes, name: object) -> np.ndarray:
    """Array of a `.npy` file's bytes; arrays of objects, which are pickles, are refused.

    Args:
        content: The bytes.
        name: Name for messages.

    Raises:
        ValueError: It is no whole `.npy` file of numbers or text.
    """
    with naming(name, "a whole .npy file of numbers"):
        return _array(io.BytesIO(content), len(content))


def load_arrays(
    source: Path | io.BytesIO, name: object, wanted: Iterable[str] | None = None
) -> dict[str, np.ndarray]:
    """Arrays of an `.npz` file by name, whose sizes are checked before they are unpacked.

    Args:
        source: The file, or a stream of its bytes.
        name: Name for messages.
        wanted: Names of the arrays to read; none for all.

    Raises:
        ValueError: It is no whole `.npz` file of numbers or text, lacks an array, or unpacks to more than
            `array_bytes` of `LIMITS`.
    """
    with naming(name, "an .npz file of arrays"), opened_zip(source, name) as archive:
        members = {member.filename.removesuffix(_SUFFIX): member for member in archive.infolist()}
        names = list(members) if wanted is None else list(wanted)
        if lacking := [one for one in names if one not in members]:
            raise ValueError(f"it has no {', '.join(lacking)}; it has {list(members)[:12]}")
        size = sum(members[one].file_size for one in names)
        if size > LIMITS.array_bytes:
            raise ValueError(too_large(name, size, "array_bytes", "bytes of arrays"))
        found = {}
        for one in names:
            expected = "an array of numbers"
            with naming(f"{name}: {one}", expected), archive.open(members[one]) as stream:
                found[one] = _array(stream, members[one].file_size)
        return found


@runtime_checkable
class Readable(Protocol):
    """A stream that is read from its beginning to its end."""

    def read(self, size: int = -1, /) -> bytes:
        """Up to `size` bytes."""


def _array(stream: Readable, size: int) -> np.ndarray:
    """Array of a stream whose header announces exactly the bytes that follow it."""
    head = io.BytesIO(stream.read(min(size, 1 << 16)))
    version = np.lib.format.read_magic(head)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)  # fmt: skip
    if read_header is None:
        raise ValueError(f"its format has the version {version}, expected 1.0 or 2.0")
    shape, _, dtype = read_header(head)
    if dtype.hasobject:
        raise ValueError(
            "it is an array of objects, a pickle, and those may run code and are not read"
        )
    announced, follow = math.prod(shape) * dtype.itemsize, size - head.tell()
    if announced != follow:
        raise ValueError(f"it announces {announced} bytes, of the shape {shape}, and has {follow}")
    head.seek(0)
    array: np.ndarray = np.lib.format.read_array(_Joined(head, stream), allow_pickle=False)
    return array


class _Joined:
    """Stream of bytes that were read ahead and of those that follow."""

    def __init__(self, head: Readable, rest: Readable) -> None:
        self.head, self.rest = head, rest

    def read(self, size: int = -1, /) -> bytes:
        """Up to `size` bytes."""
        return self.head.read(size) or self.rest.read(size)
