"""Reads images and keeps count of those that cannot be read."""

import logging
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

logger = logging.getLogger(__name__)

START_OF_SCAN, END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"


def read_image(path: Path) -> UInt8[np.ndarray, "height width 3"] | None:
    """An RGB image, or None if the file is missing, damaged or cut off.

    OpenCV fills the rest of a JPEG that was cut off with grey and says nothing that a program could
    hear, so its end is looked for here. The markers cannot occur inside compressed data.
    """
    try:
        content = path.read_bytes()
    except OSError:
        return None
    cut_off = content.rfind(END_OF_IMAGE) < content.rfind(START_OF_SCAN)
    if not content or (content.startswith(b"\xff\xd8") and cut_off):
        return None
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if image is None else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


class CorruptImages:
    """The images that were skipped, up to a limit; each loading process keeps its own count."""

    def __init__(self, limit: int) -> None:
        """Start with none.

        Args:
            limit: How many may be skipped before the run stops.
        """
        self.limit = limit
        self.names: list[str] = []

    def add(self, name: str) -> None:
        """Warn of one more; the same image counts once.

        Raises:
            RuntimeError: It is one too many.
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
