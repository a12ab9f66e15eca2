"""Folder of downloaded files with a bounded size, shared by the processes of a machine."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from hand_recon.data.cache import exclusive_lock
from hand_recon.data.shards.manifest import ShardFile

_ABANDONED: Final = 86_400.0
"""Age of an unfinished download that nobody continues, seconds."""


class BoundedCache:
    """Files by their checksums; the one that was used longest ago makes room for a new one.

    A file that another process has just opened stays readable for it after it was removed.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        """Store the settings.

        Args:
            folder: The folder.
            limit: Most bytes of all files together.
        """
        self.folder = folder
        self.limit = limit

    def path(self, file: ShardFile, fetch: Callable[[Path], None]) -> Path:
        """Path of a file, which is fetched if it is not there; of several processes, one fetches it.

        Args:
            file: The file.
            fetch: Function that puts it at a path.
        """
        target = self.folder / f"{file.sha256[:24]}{Path(file.name).suffix}"
        if self._is_there(target, file):
            return target
        self.folder.mkdir(parents=True, exist_ok=True)
        with exclusive_lock(target.with_name(f"{target.name}.lock")):
            if not self._is_there(target, file):
                with exclusive_lock(self.folder / "room.lock"):
                    self._make_room(file.bytes)
                fetch(target)
        return target

    def read(self, file: ShardFile, fetch: Callable[[Path], None], offset: int, size: int) -> bytes:
        """A range of bytes of a file, which is fetched if it is not there.

        Args:
            file: The file.
            fetch: Function that puts it at a path.
            offset: First byte.
            size: Number of bytes.
        """
        while True:
            try:
                with self.path(file, fetch).open("rb", buffering=0) as stream:
                    return os.pread(stream.fileno(), size, offset)
            except FileNotFoundError:
                # Another process has made room in the meantime.
                continue

    def _is_there(self, target: Path, file: ShardFile) -> bool:
        try:
            if target.stat().st_size != file.bytes:
                return False
            # The file system's own clock has steps of some milliseconds.
            now = time.time_ns()
            os.utime(target, ns=(now, now))
        except FileNotFoundError:
            return False
        return True

    def _make_room(self, size: int) -> None:
        """Remove files until a new one fits, and downloads that were given up."""
        used = []
        for path in self.folder.iterdir():
            try:
                known = path.stat()
            except FileNotFoundError:
                continue
            abandoned = path.suffix == ".part" and time.time() - known.st_mtime > _ABANDONED
            if abandoned:
                path.unlink(missing_ok=True)
            elif path.suffix != ".lock":
                used.append((path.suffix == ".part", known.st_mtime_ns, known.st_size, path))
        total = sum(bytes_ for _, _, bytes_, _ in used)
        for being_written, _, bytes_, path in sorted(used):
            if total + size <= self.limit or being_written:
                break
            path.unlink(missing_ok=True)
            total -= bytes_
