"""Encoded images of shards: the bytes of the file, or a smaller JPEG."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import UInt8

from hand_recon.data.images import decode_image
from hand_recon.data.photos.formats import PHOTO_SUFFIXES
from hand_recon.data.shards.index import LARGEST_IMAGE

QUALITY: Final = 92
"""Quality of the JPEG of a scaled image, where none is given."""


@dataclass(frozen=True)
class EncodedImage:
    """An image as it goes into a shard."""

    content: bytes
    """Its file."""
    suffix: str
    """Suffix of its format, with the dot."""
    scale: tuple[float, float] = (1.0, 1.0)
    """Width and height as shares of those of the file that was read."""


@dataclass(frozen=True)
class Encoding:
    """Settings of the images of shards; without any, the bytes of the files are kept.

    Raises:
        ValueError: A number cannot be a side or a quality.
    """

    max_side: int | None = None
    """Longest side, pixels; larger images are scaled down. None keeps all sizes."""
    jpeg_quality: int | None = None
    """JPEG quality of all images, 1 to 100; None encodes those alone that are scaled, with `QUALITY`."""

    def __post_init__(self) -> None:
        if self.max_side is not None and self.max_side < 1:
            raise ValueError(
                f"max_side={self.max_side}; expected pixels, 1 or more, or null to keep all sizes."
            )
        if self.jpeg_quality is not None and not 1 <= self.jpeg_quality <= 100:
            raise ValueError(f"jpeg_quality={self.jpeg_quality}; expected 1 to 100, or null.")

    def read(self, path: Path) -> EncodedImage:
        """Read an image file and encode it.

        A JPEG that is made here is upright and has no metadata.

        Args:
            path: The file.

        Raises:
            ValueError: It is damaged, missing, or beyond `LARGEST_IMAGE` as it is or encoded; or no JPEG has
                so many pixels on a side.
        """
        try:
            held = path.stat().st_size
            content = path.read_bytes() if held <= LARGEST_IMAGE else b""
        except OSError as error:
            raise ValueError(f"it cannot be read ({error.strerror})") from error
        if held > LARGEST_IMAGE:
            raise ValueError(too_many_bytes("its file", held, LARGEST_IMAGE))
        pixels = decode_image(content)
        if pixels is None:
            raise ValueError("it is damaged or no image")
        height, width = pixels.shape[:2]
        shrinks = self.max_side is not None and max(height, width) > self.max_side
        if not shrinks and self.jpeg_quality is None:
            suffix = path.suffix.lower()
            return EncodedImage(content, suffix if suffix in PHOTO_SUFFIXES else ".img")
        if self.max_side is not None and shrinks:
            ratio = self.max_side / max(height, width)
            size = (max(1, round(width * ratio)), max(1, round(height * ratio)))
            pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))
        scale = (pixels.shape[1] / width, pixels.shape[0] / height)
        return EncodedImage(_jpeg(pixels, self.jpeg_quality or QUALITY), ".jpg", scale)


def _jpeg(pixels: UInt8[np.ndarray, "height width 3"], quality: int) -> bytes:
    """Content of a JPEG file.

    Raises:
        ValueError: It cannot be encoded, or is beyond `LARGEST_IMAGE`.
    """
    reason = ""
    try:
        done, encoded = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    except cv2.error as error:
        done, encoded, reason = False, np.empty(0, np.uint8), f" ({error.err})"
    if not done or not len(encoded):
        height, width = pixels.shape[:2]
        raise ValueError(
            f"{width} × {height} pixels cannot be encoded as JPEG{reason}, which holds up to 65,500 on a "
            "side; set max_side"
        )
    if len(encoded) > LARGEST_IMAGE:
        raise ValueError(too_many_bytes("its JPEG", len(encoded), LARGEST_IMAGE))
    return encoded.tobytes()


def too_many_bytes(what: str, found: int, most: int) -> str:
    """Reason for leaving an image out whose file or labels no training would read.

    Args:
        what: Noun phrase of the content.
        found: Its bytes.
        most: Most bytes that are read.
    """
    return f"{what} has {found:,} bytes, and shards hold up to {most:,}"
