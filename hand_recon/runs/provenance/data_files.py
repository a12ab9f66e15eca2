"""Files of the data of a run, found within limits: no loops of links, no pipes, no endless folders."""

import os
import stat
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

MOST_ENTRIES: Final = 500_000
"""Files and folders that are looked at; those beyond, in the order of names, are left out."""


@dataclass(frozen=True, slots=True)
class DataFile:
    """A file of the data."""

    name: str
    """Path from the folder that was named."""
    path: str
    """Path to read it."""
    size: int
    """Bytes."""


class Walk:
    """A search for files below some folders.

    Args:
        above: Folder that the names of files begin at.
        endings: Endings of the files that count, in lower case; None for all.
    """

    def __init__(self, above: Path, endings: Set[str] | None) -> None:
        self.above, self.endings = str(above), endings
        self.looked_at = self.unreadable = 0
        self.ended_early = False
        self.visited: set[tuple[int, int]] = set()

    def files(self, paths: Sequence[Path]) -> Iterator[DataFile]:
        """Yield regular files, links to such included; hidden ones only if they are named.

        Args:
            paths: Files and folders.
        """
        waiting = [str(path) for path in reversed(paths)]
        while waiting and self.looked_at < MOST_ENTRIES:
            path = waiting.pop()
            self.looked_at += 1
            state = _state(path)
            if state is None:
                continue
            if stat.S_ISDIR(state.st_mode):
                waiting += reversed(self._below(path, state))
            elif stat.S_ISREG(state.st_mode) and self._counts(path):
                yield DataFile(os.path.relpath(path, self.above), path, state.st_size)
        self.ended_early = bool(waiting)

    def told(self) -> dict[str, Any]:
        """Entries for the record where the search had to leave something out; after `files`."""
        told: dict[str, Any] = {}
        if self.ended_early:
            told["ended_after"] = MOST_ENTRIES
        if self.unreadable:
            told["unreadable_folders"] = self.unreadable
        return told

    def _counts(self, path: str) -> bool:
        return self.endings is None or os.path.splitext(path)[1].lower() in self.endings

    def _below(self, folder: str, state: os.stat_result) -> list[str]:
        """Entries of a folder in the order of names; none for one that was visited, through a link."""
        identity = (state.st_dev, state.st_ino)
        if identity in self.visited:
            return []
        self.visited.add(identity)
        try:
            names = os.listdir(folder)
        except OSError:
            self.unreadable += 1
            return []
        return [os.path.join(folder, name) for name in sorted(names) if not name.startswith(".")]


def _state(path: str) -> os.stat_result | None:
    """State of what a path leads to; None for a link to nowhere and what cannot be looked at."""
    try:
        return os.stat(path)
    except OSError:
        return None
