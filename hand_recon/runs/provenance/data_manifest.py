"""Manifests of the data of a run: names, sizes and contents, cheap enough for every run.

Every file counts with its name and size. Contents: files of one ending are read whole if they are 200 or
fewer and 1 GiB or less together, as annotations are; of others, as images are, 64 evenly spaced ones are, and
of a file above 3 MiB its first, middle and last MiB. At most 4096 files are read. What cannot be read never
ends a run here: reading it for the training says what is wrong.
"""

import glob
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hand_recon.data.selection import evenly_spaced
from hand_recon.runs.provenance.data_files import DataFile, Walk

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

MOST_READ: Final = 4096
"""Files that are read at most."""

PIECE: Final = 2**20
"""Bytes of a piece of a large file."""

IMAGES: Final = frozenset({".jpg", ".jpeg", ".png", ".webp", ".heic", ".bmp", ".tif", ".tiff"})
"""Endings of the images beside a file of landmarks."""


def data_manifests(config: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Manifest of each file or folder that settings name, by the dotted name of the setting.

    The entries of a list have the name of the list and their number; the files that a pattern matches are one
    entry, and a URL is recorded as it is.

    Args:
        config: A run's resolved configuration.
    """
    found = {name: _entry(text, images_only) for name, text, images_only in _named(config, "")}
    return {name: entry for name, entry in found.items() if entry is not None}


def manifest(path: Path, *, images_only: bool = False) -> dict[str, Any]:
    """Number of files, bytes, and digests of names, sizes and contents.

    Args:
        path: A file or a folder; hidden files, links to nowhere and what is no file, such as a pipe, are left
            out.
        images_only: Leaves out all but images.

    Returns:
        JSON; two manifests are of the same data if all but `path` is equal. `ended_after` is there if a
        folder had more entries than are looked at, `unreadable_folders` if there were some.
    """
    return _manifest([path], path.parent if path.is_file() else path, images_only)


def _manifest(paths: Sequence[Path], above: Path, images_only: bool) -> dict[str, Any]:
    walk = Walk(above, IMAGES if images_only else None)
    files = sorted(walk.files(paths), key=lambda file: file.name)
    names = hashlib.sha256()
    for file in files:
        names.update(f"{file.name}\0{file.size}\n".encode(errors="surrogateescape"))
    chosen, whole = _chosen(files)
    contents = hashlib.sha256()
    for file in chosen:
        contents.update(_content(file, whole=file in whole))
    return {
        "path": str(paths[0].absolute() if len(paths) == 1 else above.absolute()),
        "files": len(files),
        "bytes": sum(file.size for file in files),
        "names_and_sizes": names.hexdigest(),
        "contents": contents.hexdigest(),
        "files_read": len(chosen),
        **walk.told(),
    }


def _entry(text: str, images_only: bool) -> dict[str, Any] | None:
    """Entry of one value of a setting; None if it names nothing that is there."""
    if "://" in text:
        return {"url": text}
    path = _home(text)
    # os.path answers for what cannot be looked at, too.
    if os.path.isfile(path) or os.path.isdir(path):
        return manifest(path, images_only=images_only)
    matches = sorted(glob.glob(str(path), recursive=True)) if glob.has_magic(text) else []
    if not matches:
        return None
    fixed = next(one for one in path.parents if not glob.has_magic(str(one)))
    return _manifest([Path(one) for one in matches], fixed, images_only)


def _named(node: Mapping[str, Any], above: str) -> Iterator[tuple[str, str, bool]]:
    """Settings that may name data: dotted name, value, and whether only images count."""
    for key, value in node.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            yield from _named(value, f"{name}.")
        elif key in KEYS and isinstance(value, str):
            yield name, value, False
        elif key in KEYS and isinstance(value, list):
            yield from (
                (f"{name}.{number}", one, False)
                for number, one in enumerate(value)
                if isinstance(one, str)
            )
    train = node.get("train")
    if isinstance(train, str) and node.get("images", "") is None and os.path.isfile(_home(train)):
        # Images without a folder of their own lie beside their landmarks.
        yield f"{above}images", str(_home(train).absolute().parent), True


def _home(text: str) -> Path:
    return Path(text).expanduser()


def _chosen(files: list[DataFile]) -> tuple[list[DataFile], set[DataFile]]:
    """Files to read, and those of them that are read whole."""
    groups: dict[str, list[DataFile]] = defaultdict(list)
    for file in files:
        groups[os.path.splitext(file.name)[1].lower()].append(file)
    chosen: list[DataFile] = []
    whole: set[DataFile] = set()
    for _, group in sorted(groups.items()):
        if len(group) <= MOST_WHOLE and sum(file.size for file in group) <= MOST_BYTES:
            chosen += group
            whole |= set(group)
        else:
            chosen += [group[i] for i in evenly_spaced(len(group), SAMPLED)]
    if len(chosen) > MOST_READ:
        chosen = [chosen[i] for i in evenly_spaced(len(chosen), MOST_READ)]
    return chosen, whole


def _content(file: DataFile, *, whole: bool) -> bytes:
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
