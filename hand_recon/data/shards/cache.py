"""Folder of downloaded files with a bounded size, shared by the processes of a machine.

A download has its room before it begins: a file `….room` as long as what will come, without its bytes on the
disk, counts in its place. Its process holds the file's lock, so that a room whose lock is free was given up.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from hand_recon.data.cache import exclusive_lock, lock_if_free
from hand_recon.data.shards.manifest import ShardFile

_PAUSE: Final = 0.1
"""Wait for other downloads to end before looking for room again, seconds."""


class BoundedCache:
    """Files by their checksums; the one that was used longest ago makes room for a new one.

    A file that another process has just opened stays readable for it after it was removed.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        """Store the settings.

        Args:
            folder: The folder.
            limit: Most bytes of all files together, running downloads included.
        """
        self.folder = folder
        self.limit = limit

    def path(self, file: ShardFile, fetch: Callable[[Path], None]) -> Path:
        """Path of a file, which is fetched if it is not there; of several processes, one fetches it.

        It waits for other downloads if there is room only after them.

        Args:
            file: The file.
            fetch: Function that puts it at a path.

        Raises:
            ValueError: It is larger than the cache.
        """
        # No name of a manifest decides what a file here counts as.
        target = self.folder / f"{file.sha256[:24]}.tar"
        if self._is_there(target, file):
            return target
        if file.bytes > self.limit:
            raise ValueError(
                f"{file.name} has {file.bytes / 1e6:.3g} MB, and the cache of shards holds "
                f"{self.limit / 1e6:.3g} MB. Set data.cache_gb={1.05e-9 * file.bytes:.2g} or more."
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        with exclusive_lock(_lock_of(target)):
            if not self._is_there(target, file):
                self._fetch(target, file, fetch)
        return target

    def read(self, file: ShardFile, fetch: Callable[[Path], None], offset: int, size: int) -> bytes:
        """A range of bytes of a file, which is fetched if it is not there.

        Args:
            file: The file.
            fetch: Function that puts it at a path.
            offset: First byte.
            size: Number of bytes.

        Raises:
            ValueError: It is larger than the cache.
        """
        while True:
            path = self.path(file, fetch)
            try:
                with path.open("rb", buffering=0) as stream:
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

    def _fetch(self, target: Path, file: ShardFile, fetch: Callable[[Path], None]) -> None:
        """Fetch a file, whose lock is held, into room that is kept for it."""
        room = target.with_suffix(".room")
        while not self._keep_room(room, file.bytes):
            time.sleep(_PAUSE)
        try:
            fetch(target)
        finally:
            room.unlink(missing_ok=True)

    def _keep_room(self, room: Path, size: int) -> bool:
        """Keep room for a file if, once others are removed, there is any beside the running downloads."""
        with exclusive_lock(self.folder / "room.lock"):
            # Left by a process that was killed; this one has its lock.
            room.unlink(missing_ok=True)
            self._remove_given_up()
            kept = sum(_size(path) for path in self.folder.glob("*.room"))
            if kept + size > self.limit:
                return False
            self._make_room(self.limit - kept - size)
            with room.open("wb") as stream:
                stream.truncate(size)
        return True

    def _remove_given_up(self) -> None:
        """Remove the rooms and parts of downloads whose process was killed."""
        for path in self.folder.glob("*.room"):
            target = path.with_suffix(".tar")
            with lock_if_free(_lock_of(target)) as free:
                if free:
                    path.unlink(missing_ok=True)
                    target.with_name(f"{target.name}.part").unlink(missing_ok=True)

    def _make_room(self, most: int) -> None:
        """Remove the files that were used longest ago until the others have at most some bytes."""
        used = []
        for path in self.folder.glob("*.tar"):
            try:
                known = path.stat()
            except FileNotFoundError:
                continue
            used.append((known.st_mtime_ns, known.st_size, path))
        total = sum(size for _, size, _ in used)
        for _, size, path in sorted(used):
            if total <= most:
                break
            path.unlink(missing_ok=True)
            total -= size


def _lock_of(target: Path) -> Path:
    return target.with_name(f"{target.name}.lock")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
