"""Caches of data that is slow to read or make, memory-mapped after the first time.

Caches are kept in a folder of their own, never in the dataset's. A cache's name holds a digest of everything
it depends on: a change makes a new cache, and an old one is unused but never wrong.
"""

import fcntl
import hashlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np


def digest(*parts: object) -> str:
    """Digest of everything a cache depends on, 16 hex digits.

    Args:
        parts: Arrays and bytes are hashed with type, shape and content; anything else by its `repr`, which
            abbreviates nested arrays: pass each array as a part of its own.
    """
    summed = hashlib.sha256()
    for part in parts:
        kind, content = _content(part)
        # The length marks the end of each part, so that different lists of parts never give the same bytes.
        summed.update(f"{kind} {len(content)}\n".encode())
        summed.update(content)
    return summed.hexdigest()[:16]


def _content(part: object) -> tuple[str, bytes | memoryview]:
    """Kind and bytes of a part; large buffers are neither copied nor printed.

    Raises:
        TypeError: The part is an array of objects, whose buffer holds addresses.
    """
    if isinstance(part, bytes):
        return "bytes", part
    if not isinstance(part, np.ndarray):
        return "repr", repr(part).encode()
    if part.dtype.hasobject:
        raise TypeError("The content of an array of objects cannot be hashed; give a list instead.")
    flat = np.ascontiguousarray(part).reshape(-1).view(np.uint8)
    return f"array {part.dtype.str} {part.shape}", flat.data


def file_identity(path: Path) -> tuple[str, int, int]:
    """Path, size and modification time, which together identify the content of a file."""
    status = path.stat()
    return str(path.resolve()), status.st_size, status.st_mtime_ns


def ensure_built(target: Path, build: Callable[[Path], None]) -> None:
    """Build a cache folder if it is missing; of several processes, one builds it.

    It is built under another name and renamed when complete, so that a run that was killed leaves no
    incomplete cache.

    Args:
        target: The cache folder.
        build: Function that fills the empty folder it is given.
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


@contextmanager
def lock_if_free(path: Path) -> Iterator[bool]:
    """Hold the lock of a file if nobody else does: True, or False at once."""
    with path.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


class MappedArray:
    """Memory-mapped array file, opened on first use; pickling it for a worker process sends only its path."""

    def __init__(self, path: Path) -> None:
        """Store the path."""
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
