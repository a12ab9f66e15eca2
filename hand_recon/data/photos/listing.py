"""Photographs named by files, folders and patterns."""

import glob
import logging
import os
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from hand_recon.data.photos.formats import PHOTO_SUFFIXES, PhotoError, kind_of_file, shown

logger = logging.getLogger(__name__)


def photo_files(paths: Iterable[str | Path]) -> list[Path]:
    """Expand files, folders with all folders below, and patterns such as `*.jpg` to photographs.

    The order is that of the arguments, and natural within each (2 before 10). A file that is named is kept
    whatever it is, also by a pattern; in folders, hidden files and folders are left out, and files that are
    no photographs, neither by content nor by suffix, with a note that counts them. A file that is found
    twice is kept once.

    Raises:
        PhotoError: A path does not exist, a pattern matches nothing, or there is no photograph at all.
    """
    found: dict[str, Path] = {}
    skipped: Counter[str] = Counter()
    arguments = list(paths)
    for argument in arguments:
        for path in _expanded(Path(argument), skipped):
            found.setdefault(os.path.realpath(path), path)
    if skipped:
        counts = ", ".join(f"{count} {name}" for name, count in sorted(skipped.items()))
        logger.info("Left out of the folders: %s.", counts)
    if not found:
        raise PhotoError(
            f"Found no photograph in {', '.join(map(shown, arguments)) or 'an empty list'}; expected "
            "files such as JPEG, PNG or HEIC, or folders of them. Name another file or folder."
        )
    return list(found.values())


def natural_order(path: Path) -> tuple[tuple[int | str, ...], ...]:
    """Sorting key by which numbers in names count as numbers: 2 before 10, upper and lower case alike.

    >>> [path.name for path in sorted([Path("hand10.jpg"), Path("Hand2.jpg")], key=natural_order)]
    ['Hand2.jpg', 'hand10.jpg']
    """
    # Pieces alternate between words and numbers, so that like is compared with like.
    return tuple(
        tuple(
            int(piece) if index % 2 else piece.casefold()
            for index, piece in enumerate(re.split(r"(\d+)", part))
        )
        for part in (*path.parent.parts, path.stem, path.suffix)
    )


def _expanded(argument: Path, skipped: Counter[str]) -> list[Path]:
    if argument.is_dir():
        return _photos_below(argument, skipped)
    if os.path.lexists(argument):
        return [argument]
    pattern = str(argument)
    matches = glob.glob(pattern, recursive=True) if glob.has_magic(pattern) else []
    if not matches:
        wrong = "matches no file" if glob.has_magic(pattern) else "does not exist"
        raise PhotoError(
            f"{shown(argument)} {wrong}; expected a file, a folder or a pattern such as *.jpg. Check "
            "the name."
        )
    files: list[Path] = []
    for match in sorted(map(Path, matches), key=natural_order):
        files += _photos_below(match, skipped) if match.is_dir() else [match]
    return files


def _photos_below(folder: Path, skipped: Counter[str]) -> list[Path]:
    kept = []
    for path in sorted(folder.rglob("*"), key=natural_order):
        if path.is_dir():
            continue
        if any(part.startswith(".") for part in path.relative_to(folder).parts):
            skipped["hidden"] += 1
        elif reason := _reason_to_skip(path):
            skipped[reason] += 1
        else:
            kept.append(path)
    return kept


def _reason_to_skip(path: Path) -> str:
    """Plural name of what a file is instead of a photograph; "" for a photograph.

    A damaged file with a photograph's suffix is kept: reading it says what is wrong.
    """
    try:
        kind = kind_of_file(path) if path.is_file() else None
    except OSError:
        kind = None
    if (kind and kind.is_photo) or path.suffix.lower() in PHOTO_SUFFIXES:
        return ""
    return {"video": "videos", "raw": "raw files"}.get(kind.name if kind else "", "other files")
