"""Finds the image files that a landmark file names, also where it was written on another machine."""

import logging
import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

logger = logging.getLogger(__name__)

Listings = dict[Path, dict[str, list[Path]]]
"""Files of the folders searched so far, by their folded names."""


def located_images(
    path: Path, root: Path, written: Sequence[str | None]
) -> tuple[Path | None, ...]:
    """Image file of each hand; the path as written where no file is found.

    A path that does not exist is tried with slashes for backslashes, without drive, scheme and percent codes,
    without its leading folders, and in another case. Two different paths that would lead to one file are left
    as they are, because their folders matter.

    Args:
        path: The landmark file, for messages.
        root: Folder of the images.
        written: Paths in the landmark file; None for hands without an image.
    """
    listings: Listings = {}
    located = {name: _locate(root, name, listings) for name in dict.fromkeys(written) if name}
    leading_there = defaultdict(set)
    for name, file in located.items():
        leading_there[file].add(_parts(name))
    for name, file in located.items():
        if len(leading_there[file]) > 1:
            located[name] = root / name
    moved = [name for name, file in located.items() if file != root / name]
    if moved:
        logger.info(
            "%s: %d of %d images are not at the written path and were found elsewhere; the first: %r is read "
            "from %s.",
            path, len(moved), len(located), moved[0], located[moved[0]],
        )  # fmt: skip
    return tuple(located[name] if name else None for name in written)


def searched_places(root: Path, written: str, most: int = 4) -> list[str]:
    """Paths at which an image was looked for, the path as written first, for a message."""
    places = [root / written, *_alternatives(root, written)]
    return [str(place) for place in dict.fromkeys(places)][:most]


def _locate(root: Path, written: str, listings: Listings) -> Path:
    """The path as written, or the first alternative at which there is a file."""
    direct = root / written
    try:
        if direct.is_file():
            return direct
        for place in _alternatives(root, written):
            if place.is_file():
                return place
            same = _ignoring_case(place, listings)
            if same is not None:
                return same
    except (OSError, ValueError):
        # A name that the file system cannot hold, such as one that is too long.
        return direct
    return direct


def _alternatives(root: Path, written: str) -> Iterator[Path]:
    """Paths below the folder of the images: the whole path first, then without its leading folders."""
    parts = _parts(written)
    for start in range(len(parts)):
        yield root.joinpath(*parts[start:])


def _parts(written: str) -> tuple[str, ...]:
    """Folders and name of a path, without drive, scheme, host, `.`, `..` and percent codes."""
    text = written
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", text):
        text = urlsplit(text).path
    # Label Studio serves local files as `/data/local-files/?d=<path>`.
    text = unquote(text.rpartition("?d=")[2])
    text = re.sub(r"^[A-Za-z]:(?=/)", "", text.replace("\\", "/"))
    return tuple(part for part in PurePosixPath(text).parts if part not in ("/", "//", ".", ".."))


def _ignoring_case(place: Path, listings: Listings) -> Path | None:
    """The only file in a folder whose name differs in case or in Unicode's form alone."""
    folder = place.parent
    if folder not in listings:
        names = defaultdict(list)
        for file in folder.iterdir() if folder.is_dir() else ():
            names[_folded(file.name)].append(file)
        listings[folder] = dict(names)
    same = listings[folder].get(_folded(place.name), [])
    return same[0] if len(same) == 1 and same[0].is_file() else None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
