"""What is slow to read is read once and then mapped into memory.

Caches live in a folder of their own, never in the dataset's. Their names hold a digest of all that
they depend on: a change makes a new cache, and an old one is never wrong, only unused.
"""

import fcntl
import hashlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np


def digest(*parts: object) -> str:
    """A short name for whatever a cache depends on.

    Args:
        parts: Arrays and bytes count with their type, shape and content; anything else as `repr` shows it,
            which shortens an array that is inside something else: give each as a part of its own.
    """
    summed = hashlib.sha256()
    for part in parts:
        kind, content = _content(part)
        # The length says where each part ends: no two lists of parts run together into the same bytes.
        summed.update(f"{kind} {len(content)}\n".encode())
        summed.update(content)
    return summed.hexdigest()[:16]


def _content(part: object) -> tuple[str, bytes | memoryview]:
    """What a part is, and its bytes: large buffers are neither copied nor printed.

    Raises:
        TypeError: It is an array of objects, whose buffer holds addresses.
    """
    if isinstance(part, bytes):
        return "bytes", part
    if not isinstance(part, np.ndarray):
        return "repr", repr(part).encode()
    if part.dtype.hasobject:
        raise TypeError("An array of objects has no content to tell it by; give a list instead.")
    flat = np.ascontiguousarray(part).reshape(-1).view(np.uint8)
    return f"array {part.dtype.str} {part.shape}", flat.data


def file_identity(path: Path) -> tuple[str, int, int]:
    """Path, size and time of change: no other file, nor this one once changed, has the same."""
    status = path.stat()
    return str(path.resolve()), status.st_size, status.st_mtime_ns


def ensure_built(target: Path, build: Callable[[Path], None]) -> None:
    """Make a cache folder unless it is there, once however many processes ask.

    It is built under another name and renamed when complete: a run that was killed leaves nothing
    that could be mistaken for a cache.

    Args:
        target: The folder.
        build: Fills the empty folder that it is given.
    """
    if target.is_dir():
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f"{target.name}.partial")
    with exclusive_lock(target.with_name(f"{target.name}.lock")):
        if target.is_dir():
            return
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        try:
            build(partial)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        partial.rename(target)


@contextmanager
def exclusive_lock(path: Path) -> Iterator[None]:
    """Wait until no other process holds the lock of a file, which is made if it is missing.

    The system frees the lock of a process that was killed.
    """
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


class MappedArray:
    """An array in a file, opened when first read: a worker process is sent its path, not a copy."""

    def __init__(self, path: Path) -> None:
        """Remember where the array is."""
        self.path = path
        self._array: np.ndarray | None = None

    @property
    def array(self) -> np.ndarray:
        """The array, read only; its pages are read from the disk as they are touched."""
        if self._array is None:
            self._array = np.load(self.path, mmap_mode="r", allow_pickle=False)
        return self._array

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, index: int) -> np.ndarray:
        return np.array(self.array[index])

    def __reduce__(self) -> tuple[type["MappedArray"], tuple[Path]]:
        return MappedArray, (self.path,)
