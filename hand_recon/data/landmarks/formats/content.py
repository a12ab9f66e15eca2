"""Contents of a landmark file: text in any Unicode encoding, JSON or JSON lines; other kinds are named."""

import codecs
import json
from pathlib import Path
from typing import Any, Final

from hand_recon.reading.text import parse_json

_DEEPLABCUT_CURE: Final = (
    "If it is DeepLabCut's, write it as CSV: pandas.read_hdf(file).to_csv(name), or analyse with "
    "save_as_csv=True."
)

_KINDS: Final = (
    (b"\x89HDF", f"an HDF5 file. {_DEEPLABCUT_CURE}"),
    (b"PK\x03\x04", "a zip archive. Unpack it and give the file in it, such as CVAT's annotations.xml."),
    (b"\x1f\x8b", "a gzip archive. Unpack it and give the file in it."),
    (b"\x80\x03", "a pickle. Write its landmarks as JSON: a list of hands of 21 points."),
    (b"\x80\x04", "a pickle. Write its landmarks as JSON: a list of hands of 21 points."),
    (b"\x80\x05", "a pickle. Write its landmarks as JSON: a list of hands of 21 points."),
    (b"PAR1", "a Parquet table. Write it as CSV."),
    (b"\xff\xd8\xff", "a JPEG image. Give the landmarks that a detector found in it."),
    (b"\x89PNG", "a PNG image. Give the landmarks that a detector found in it."),
    (b"%PDF", "a PDF document."),
)  # fmt: skip
"""First bytes of a file, and what it is."""

_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte order marks and encodings; UTF-32's first, because UTF-16's is its beginning."""


def to_text(path: Path, content: bytes) -> str:
    """Text of a file in UTF-8, UTF-16 or UTF-32, with a byte order mark or without.

    Raises:
        ValueError: It is not text.
    """
    kind = next((kind for start, kind in _KINDS if content.startswith(start)), None)
    if kind is not None:
        raise ValueError(f"{path} is not text: it is {kind}")
    if content[4:8] == b"ftyp":
        raise ValueError(
            f"{path} is not text: it is a video or an image of a telephone. Give the landmarks that a "
            "detector found in it."
        )
    try:
        return content.decode(_encoding(content))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not text ({error}); expected JSON or CSV.") from error


def _encoding(content: bytes) -> str:
    marked = next((name for mark, name in _MARKS if content.startswith(mark)), None)
    if marked is not None:
        return marked
    # JSON and CSV begin with two ASCII characters, which hold a zero byte each in UTF-16.
    if content[1:2] == b"\0":
        return "utf-16-le"
    return "utf-16-be" if content[:1] == b"\0" else "utf-8"


def to_json(path: Path, text: str) -> tuple[Any, bool]:
    """The value of a JSON text, or the list of values of JSON lines.

    Returns:
        The value, and True for JSON lines.

    Raises:
        ValueError: It is neither, or nested too deeply.
    """
    try:
        return parse_json(text, path), False
    except ValueError as error:
        if not isinstance(error.__cause__, json.JSONDecodeError):
            raise
        lines = [line for line in text.split("\n") if line.strip()]
        try:
            # Of a file that is cut off, the first line alone is not JSON either.
            values = [parse_json(line, path) for line in lines] if len(lines) > 1 else []
        except ValueError:
            values = []
        if values:
            return values, True
        raise ValueError(
            f"{path} is not complete JSON ({error.__cause__}). It may be cut off: write or copy it again. "
            "JSON lines hold one object or list on each line."
        ) from error
