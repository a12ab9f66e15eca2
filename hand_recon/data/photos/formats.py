"""Kinds of files, told by their first bytes: photographs that can be read, and what people give instead."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

HEADER: Final = 64
"""Bytes at the beginning of a file that tell its kind."""

RAW_SUFFIXES: Final = frozenset(
    [
        ".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dng", ".erf", ".iiq", ".kdc", ".mos", ".mrw",
        ".nef", ".nrw", ".orf", ".pef", ".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw",
        ".x3f",
    ]
)  # fmt: skip
"""Suffixes of cameras' raw files. Most are TIFF files inside, whose first image is a thumbnail."""

PHOTO_SUFFIXES: Final = frozenset(
    [
        ".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".png", ".apng", ".webp", ".tif", ".tiff",
        ".avif", ".avifs", ".heic", ".heif", ".hif", ".gif", ".bmp", ".dib", ".jp2", ".j2k",
        ".ppm", ".pgm", ".pbm", ".pnm",
    ]
)  # fmt: skip
"""Suffixes of the formats that `read_photo` reads."""

_ADVICE_TO_EXPORT: Final = "Export it as JPEG or PNG and give that file."
_AT_START: Final = (
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"GIF87a", "GIF"),
    (b"GIF89a", "GIF"),
    (b"II*\0", "TIFF"),
    (b"MM\0*", "TIFF"),
    (b"II+\0", "TIFF"),
    (b"MM\0+", "TIFF"),
    (b"\0\0\0\x0cjP  ", "JPEG2000"),
    (b"\xff\x4f\xff\x51", "JPEG2000"),
    (b"\x1aE\xdf\xa3", "video"),
    (b"\0\0\x01\xba", "video"),
    (b"\0\0\x01\xb3", "video"),
    (b"0&\xb2u\x8ef\xcf\x11", "video"),
    (b"FLV\x01", "video"),
    (b"OggS", "video"),
    (b"FUJIFILMCCD-RAW", "raw"),
    (b"%PDF", "PDF"),
    (b"%!PS", "PostScript"),
    (b"8BPS", "PSD"),
    (b"\xff\x0a", "JPEG XL"),
    (b"\0\0\0\x0cJXL ", "JPEG XL"),
    (b"PK\x03\x04", "ZIP"),
)
_CAMERA_BRANDS: Final = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")


class PhotoError(ValueError):
    """A file that is no readable photograph; the message says what it is and what to do."""


def shown(path: str | Path) -> str:
    """A path as text that can be printed everywhere: bytes that are no letters become escapes."""
    return str(path).encode("utf-8", "backslashreplace").decode("utf-8")


@dataclass(frozen=True)
class Kind:
    """Kind of a file."""

    name: str
    """Format, such as "JPEG"; "" if it is not recognised."""
    refusal: str
    """Sentences that say what the file is and what to do; "" for a format that may be a photograph."""

    @property
    def is_photo(self) -> bool:
        """True for the formats that `read_photo` reads."""
        return not self.refusal


_REFUSED: Final = {
    "video": "It is a video, which is given alone: hand-recon predict clip.mp4.",
    "raw": f"It is a camera's raw file. {_ADVICE_TO_EXPORT}",
    "PDF": f"It is a PDF document. {_ADVICE_TO_EXPORT}",
    "PostScript": f"It is a PostScript document. {_ADVICE_TO_EXPORT}",
    "PSD": f"It is a Photoshop document. {_ADVICE_TO_EXPORT}",
    "JPEG XL": f"It is a JPEG XL image, which is not read. {_ADVICE_TO_EXPORT}",
    "SVG": f"It is an SVG drawing. {_ADVICE_TO_EXPORT}",
    "HTML": "It is a web page, perhaps saved in place of the image. Download the image itself.",
    "ZIP": "It is a ZIP archive. Unpack it and give the images in it.",
    "text": "It is text. Give a photograph, such as a JPEG or PNG file.",
    "": "Its content is not that of any format that is read: JPEG, PNG, WebP, TIFF, AVIF, HEIC, GIF, BMP. "
    "Export it as JPEG or PNG.",
    "empty": "It is empty (0 bytes). Copy or download it again.",
}


def kind_of(header: bytes, suffix: str) -> Kind:
    """Tell the kind of a file by its content; its suffix matters for raw files alone.

    Args:
        header: The first `HEADER` bytes, or the whole file if it is shorter.
        suffix: Suffix of its name, with the dot.
    """
    name = _name(header)
    if name == "TIFF" and (suffix.lower() in RAW_SUFFIXES or header[8:10] == b"CR"):
        name = "raw"
    return Kind(name, _REFUSED.get(name, ""))


def kind_of_file(path: Path) -> Kind:
    """Tell the kind of a file by its first bytes.

    Raises:
        OSError: The file cannot be opened.
    """
    with path.open("rb") as stream:
        return kind_of(stream.read(HEADER), path.suffix)


def _name(header: bytes) -> str:
    if not header:
        return "empty"
    if header[4:8] == b"ftyp":
        return _name_by_brands(header)
    if header[4:8] in (b"moov", b"mdat", b"wide", b"free", b"skip"):
        return "video"
    return _name_by_start(header) or _name_of_text(header)


def _name_by_start(header: bytes) -> str:
    if header[:4] == b"RIFF":
        return {b"WEBP": "WEBP", b"AVI ": "video"}.get(header[8:12], "")
    if header[:2] == b"BM" and header[6:10] == bytes(4):
        return "BMP"
    if re.match(rb"P[1-6]\s", header):
        return "PPM"
    return next((name for start, name in _AT_START if header.startswith(start)), "")


def _name_by_brands(header: bytes) -> str:
    """Tell AVIF, HEIF, raw files and videos apart by the brands of an ISO base media file."""
    length = min(int.from_bytes(header[:4], "big"), len(header))
    brands = [header[8:12], *(header[i : i + 4] for i in range(16, length - 3, 4))]
    if brands[0] == b"crx ":
        return "raw"
    if brands[0] in (b"avif", b"avis") or (brands[0] in (b"mif1", b"msf1") and b"avif" in brands):
        return "AVIF"
    return "HEIF" if brands[0] in _CAMERA_BRANDS else "video"


def _name_of_text(header: bytes) -> str:
    words = header.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if words.startswith((b"<svg", b"<?xml")):
        return "SVG" if b"html" not in words else "HTML"
    if words.startswith((b"<!doctype html", b"<html")):
        return "HTML"
    try:
        text = header.decode("utf-8")
    except UnicodeDecodeError as error:
        # A letter may be cut in two at the end of the header.
        if error.start < len(header) - 3:
            return ""
        text = header[: error.start].decode("utf-8")
    return "text" if all(letter.isprintable() or letter.isspace() for letter in text) else ""
