"""Manifests of the data of a run: names, sizes and contents, cheap enough for every run.

Every file counts with its name and size. Contents: files of one ending are read whole if they are 200 or
fewer and 1 GiB or less together, as annotations are; of others, as images are, 64 evenly spaced ones are, and
of a file above 3 MiB its first, middle and last MiB.
"""

import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hand_recon.data.selection import evenly_spaced

KEYS: Final = frozenset(
    {
        "root", "eval_root", "train", "val", "test", "images", "mano", "path", "start_from", "weights",
        "ranges", "shards",
    }
)  # fmt: skip
"""Last parts of the names of settings that may name data."""

MOST_WHOLE: Final = 200
"""Files of one ending that are read whole at most."""

MOST_BYTES: Final = 2**30
"""Bytes of the files of one ending that are read whole at most."""

SAMPLED: Final = 64
"""Files that are read of an ending with more."""

PIECE: Final = 2**20
"""Bytes of a piece of a large file."""

IMAGES: Final = frozenset({".jpg", ".jpeg", ".png", ".webp", ".heic", ".bmp", ".tif", ".tiff"})
"""Endings of the images beside a file of landmarks."""


@dataclass(frozen=True)
class _File:
    """A file of the data."""

    name: str
    """Path from the folder that was named."""
    path: str
    """Path to read it."""
    size: int
    """Bytes."""


def data_manifests(config: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Manifest of each file or folder that settings name, by the dotted name of the setting.

    Args:
        config: A run's resolved configuration.
    """
    return {
        name: manifest(path, images_only=images_only)
        for name, path, images_only in _named(config, "")
        if path.exists()
    }


def manifest(path: Path, *, images_only: bool = False) -> dict[str, Any]:
    """Number of files, bytes, and digests of names, sizes and contents.

    Args:
        path: A file or a folder; hidden files and links to nowhere are left out.
        images_only: Leaves out all but images.

    Returns:
        JSON; two manifests are of the same data if all but `path` is equal.
    """
    files = sorted(_files(path, images_only), key=lambda file: file.name)
    names = hashlib.sha256()
    for file in files:
        names.update(f"{file.name}\0{file.size}\n".encode(errors="surrogateescape"))
    chosen, whole = _chosen(files)
    contents = hashlib.sha256()
    for file in chosen:
        contents.update(_content(file, whole=file in whole))
    return {
        "path": str(path.absolute()),
        "files": len(files),
        "bytes": sum(file.size for file in files),
        "names_and_sizes": names.hexdigest(),
        "contents": contents.hexdigest(),
        "files_read": len(chosen),
    }


def _named(node: Mapping[str, Any], above: str) -> Iterator[tuple[str, Path, bool]]:
    """Settings that may name data: dotted name, path, and whether only images count."""
    for key, value in node.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            yield from _named(value, f"{name}.")
        elif key in KEYS and isinstance(value, str):
            yield name, Path(value).expanduser(), False
    train = node.get("train")
    if isinstance(train, str) and node.get("images", "") is None and Path(train).is_file():
        # Images without a folder of their own lie beside their landmarks.
        yield f"{above}images", Path(train).expanduser().absolute().parent, True


def _files(path: Path, images_only: bool) -> Iterator[_File]:
    if path.is_file():
        yield _File(path.name, str(path), path.stat().st_size)
        return
    for entry in _entries(str(path)):
        if images_only and os.path.splitext(entry.name)[1].lower() not in IMAGES:
            continue
        try:
            size = entry.stat().st_size
        except OSError:
            continue
        yield _File(os.path.relpath(entry.path, path), entry.path, size)


def _entries(folder: str) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                continue
            if entry.is_dir():
                yield from _entries(entry.path)
            else:
                yield entry


def _chosen(files: list[_File]) -> tuple[list[_File], set[_File]]:
    """Files to read, and those of them that are read whole."""
    groups: dict[str, list[_File]] = defaultdict(list)
    for file in files:
        groups[os.path.splitext(file.name)[1].lower()].append(file)
    chosen: list[_File] = []
    whole: set[_File] = set()
    for _, group in sorted(groups.items()):
        if len(group) <= MOST_WHOLE and sum(file.size for file in group) <= MOST_BYTES:
            chosen += group
            whole |= set(group)
        else:
            chosen += [group[i] for i in evenly_spaced(len(group), SAMPLED)]
    return chosen, whole


def _content(file: _File, *, whole: bool) -> bytes:
    """Digest of a file, or of its pieces."""
    found = hashlib.sha256(file.name.encode(errors="surrogateescape"))
    try:
        with open(file.path, "rb") as stream:
            if whole or file.size <= 3 * PIECE:
                while piece := stream.read(PIECE):
                    found.update(piece)
            else:
                for start in (0, (file.size - PIECE) // 2, file.size - PIECE):
                    stream.seek(start)
                    found.update(stream.read(PIECE))
    except OSError as error:
        # Reading it for the training says what is wrong.
        found.update(f"unreadable: {error.errno}".encode())
    return found.digest()
