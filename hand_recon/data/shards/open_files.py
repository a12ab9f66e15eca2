"""Files that are read at many places: descriptors of a bounded number, shared by all shards of a process."""

import itertools
import os
import threading
import weakref
from pathlib import Path
from typing import Final

OPEN_FILES: Final = 128
"""Files of shards that a process keeps open; systems allow 256 and more of all kinds."""


class _Descriptors:
    """Descriptors by owner and path; the one that was used longest ago is closed for a new one."""

    def __init__(self, most: int) -> None:
        self.most = most
        # In the order of use.
        self.open: dict[tuple[int, Path], int] = {}
        self.renew_lock()

    def renew_lock(self) -> None:
        # Garbage may be collected, and close files, while the same thread reads.
        self.lock = threading.RLock()

    def read(self, owner: int, path: Path, size: int, offset: int) -> bytes:
        with self.lock:
            # Reading at a place does not move a descriptor, so that forked processes may share it.
            return os.pread(self._descriptor((owner, path)), size, offset)

    def close(self, owner: int) -> None:
        with self.lock:
            for key in [key for key in self.open if key[0] == owner]:
                os.close(self.open.pop(key))

    def _descriptor(self, key: tuple[int, Path]) -> int:
        found = self.open.pop(key, None)
        if found is None:
            while len(self.open) >= self.most:
                os.close(self.open.pop(next(iter(self.open))))
            found = os.open(key[1], os.O_RDONLY)
        self.open[key] = found
        return found


DESCRIPTORS: Final = _Descriptors(OPEN_FILES)
"""Those of this process. A forked process has copies of its own of all, and closes none of its parent's."""

# Another thread may hold the lock while the process forks.
os.register_at_fork(after_in_child=DESCRIPTORS.renew_lock)

_OWNERS: Final = itertools.count()


class OpenFiles:
    """Reader of the files of one owner, which are closed when it is dropped."""

    def __init__(self) -> None:
        """Begin with no open file."""
        self._owner = next(_OWNERS)
        weakref.finalize(self, DESCRIPTORS.close, self._owner)

    def read(self, path: Path, size: int, offset: int) -> bytes:
        """A range of bytes of a file, shorter where the file is.

        Args:
            path: The file, which must not be replaced in the meantime.
            size: Number of bytes.
            offset: First byte.

        Raises:
            OSError: It cannot be opened or read.
        """
        return DESCRIPTORS.read(self._owner, path, size, offset)

    def __reduce__(self) -> tuple[type["OpenFiles"], tuple[()]]:
        return OpenFiles, ()
