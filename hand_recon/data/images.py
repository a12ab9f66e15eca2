"""Reads images and keeps count of those that cannot be read."""

import logging
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from hand_recon.reading.image_header import announced_pixels
from hand_recon.reading.limits import LIMITS, too_large

logger = logging.getLogger(__name__)

START_OF_SCAN, END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"


def read_image(path: Path) -> UInt8[np.ndarray, "height width 3"] | None:
    """Read an RGB image; None if the file is missing, damaged or cut off."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return decode_image(content)


def decode_image(content: bytes) -> UInt8[np.ndarray, "height width 3"] | None:
    """Decode an RGB image; None if it is damaged, cut off or larger than `image_pixels` of `LIMITS`.

    A JPEG whose header does not tell its size counts as damaged. OpenCV silently fills the rest of a
    truncated JPEG with grey, so its end marker is looked for here. The markers cannot occur inside
    compressed data.
    """
    pixels = announced_pixels(content)
    if pixels is not None and pixels > LIMITS.image_pixels:
        logger.warning("%s", too_large("An image", pixels, "image_pixels", "pixels"))
        return None
    cut_off = content.rfind(END_OF_IMAGE) < content.rfind(START_OF_SCAN)
    if not content or (content.startswith(b"\xff\xd8") and (pixels is None or cut_off)):
        return None
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


class CorruptImages:
    """Record of skipped images, up to a limit; each loading process keeps its own."""

    def __init__(self, limit: int) -> None:
        """Start with none.

        Args:
            limit: Number of images that may be skipped before the run stops.
        """
        self.limit = limit
        self.names: list[str] = []

    def add(self, name: str) -> None:
        """Record one skipped image with a warning; the same image counts once.

        Raises:
            RuntimeError: More images are skipped than the limit allows.
        """
        if name in self.names:
            return
        self.names.append(name)
        logger.warning(
            "Cannot read %s: the next sample takes its place (%d skipped, at most %d may be).",
            name, len(self.names), self.limit,
        )  # fmt: skip
        if len(self.names) > self.limit:
            raise RuntimeError(
                f"{len(self.names)} images cannot be read, more than max_corrupt={self.limit}: "
                f"{', '.join(self.names)}. Unpack the archive again, or raise max_corrupt if these "
                "samples may be missed."
            )
