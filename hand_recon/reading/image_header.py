"""Number of pixels that the header of an image announces, before anything is decoded."""

import io
import re
import struct
import warnings
from typing import Final

from PIL import Image

_PNG: Final = b"\x89PNG\r\n\x1a\n"
_JPEG: Final = b"\xff\xd8"
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Second bytes of JPEG's markers that a frame's height and width follow."""
_ALONE: Final = frozenset({0x01, *range(0xD0, 0xD8)})
"""Second bytes of markers that no length follows."""
_ENDS: Final = frozenset({0xD8, 0xD9, 0xDA})
"""Second bytes of markers that have to follow a frame's: another image, the end, compressed data."""
_MARKER: Final = re.compile(rb"\xff([^\x00\xff])", re.DOTALL)
"""Any marker: 00 is no second byte, and FF before a marker fills."""


def announced_pixels(content: bytes) -> int | None:
    """Width times height by the header; None if it is no image whose header can be read.

    PNG and JPEG, which datasets have, take a few microseconds; Pillow reads the headers of the others.

    Args:
        content: The file's bytes.
    """
    if content.startswith(_PNG):
        size = struct.unpack_from(">II", content, 16) if len(content) >= 24 else None
        return None if size is None else size[0] * size[1]
    if content.startswith(_JPEG):
        return _pixels_of_jpeg(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as image:
                return image.width * image.height
    except Image.DecompressionBombError as error:
        # Pillow tells the number in its message alone.
        found = re.search(r"\d+", str(error))
        return None if found is None else int(found[0])
    except Exception:  # noqa: BLE001  # a damaged image raises anything
        return None


def _pixels_of_jpeg(content: bytes) -> int | None:
    """Height times width of the first frame's marker, looked for from marker to marker as libjpeg does."""
    position = len(_JPEG)
    # Bytes before a marker are skipped, and a decoder tells no more than a warning about them.
    while marker := _MARKER.search(content, position):
        kind, position = marker[1][0], marker.end()
        if kind in _ENDS:
            return None
        if kind in _FRAMES:
            size = content[position + 3 : position + 7]
            height, width = int.from_bytes(size[:2], "big"), int.from_bytes(size[2:], "big")
            return height * width if len(size) == 4 else None
        if kind not in _ALONE:
            # Lengths count themselves; a shorter one would never end.
            position += max(int.from_bytes(content[position : position + 2], "big"), 2)
    return None
