"""Files from a browser: their kind, and the photograph or the landmarks in them."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

from hand_recon.data.photos.formats import HEADER, kind_of
from hand_recon.fitting.hand_entry import KEYS

LANDMARK_SUFFIXES: Final = frozenset({".json", ".jsonl", ".csv", ".npy", ".xml", ".pose"})
"""Suffixes of files that are no photographs, whatever they hold."""

_LONGEST_STEM, _LONGEST_SUFFIX = 100, 20
"""Most bytes of a file's name and of its suffix; file systems refuse more than 255 together."""

UploadKind = Literal["photo", "landmarks", "hands"]
"""A photograph, 2D landmarks, or a file of reconstructed hands."""


def upload_kind(name: str, content: bytes) -> UploadKind:
    """Tell what a file is by its content, and by its name where that does not say.

    Args:
        name: The file's name.
        content: Its bytes.
    """
    suffix = Path(name).suffix.lower()
    is_text = kind_of(content[:HEADER], suffix).name == "text"
    if not is_text and suffix not in LANDMARK_SUFFIXES:
        return "photo"
    return "hands" if _holds_hands(content) else "landmarks"


@contextmanager
def saved(name: str, content: bytes) -> Iterator[Path]:
    """Save a file in a folder of its own, which is removed afterwards.

    Args:
        name: The file's name in the browser.
        content: Its bytes.

    Raises:
        ValueError: What the block raises, without the folder's name in the text.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / safe_name(name)
        path.write_bytes(content)
        try:
            yield path
        except (ValueError, OSError, MemoryError) as error:
            text = str(error) or type(error).__name__
            raise ValueError(text.replace(f"{folder}/", "").replace(folder, "")) from error


def safe_name(name: str) -> str:
    """A file's name without folders and without characters that file systems refuse.

    Args:
        name: The file's name in the browser.
    """
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    kept = "".join(one for one in last if one.isprintable() and one not in '<>:"|?*')
    kept = kept.strip(" .") or "file"
    stem, suffix = Path(kept).stem, Path(kept).suffix
    return f"{_cut(stem, _LONGEST_STEM)}{_cut(suffix, _LONGEST_SUFFIX)}"


def _cut(text: str, most: int) -> str:
    """The beginning of a text, of whole characters that take at most so many bytes."""
    return text.encode("utf-8", "replace")[:most].decode("utf-8", "ignore")


def _holds_hands(content: bytes) -> bool:
    """True for a list of hands as `hands.json` has them, or lines of them."""
    try:
        text = content.decode("utf-8").lstrip()
        found = json.loads(text.partition("\n")[0] if text.startswith("{") else text)
    except (ValueError, RecursionError):
        return False
    first = found[0] if isinstance(found, list) and found else found
    return isinstance(first, dict) and set(KEYS) <= set(first)
