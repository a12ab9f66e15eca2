"""Reading by OpenCV: opened without messages, released whatever happens."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import UInt8

from hand_recon.data.video.frames import VideoError
from hand_recon.data.video.quiet import quiet, quiet_opening


@runtime_checkable
class Capture(Protocol):
    """The part of `cv2.VideoCapture` that is used, for cameras in tests."""

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        """Tell whether there is something to read."""
        ...

    def grab(self) -> bool:
        """Decode the next frame; false at the end."""
        ...

    def retrieve(self) -> tuple[bool, Any]:
        """Convert the frame to BGR; false if it cannot be."""
        ...

    def get(self, propId: int, /) -> float:  # OpenCV's name
        """Look up a property by its number."""
        ...

    def release(self) -> None:
        """Close the source."""
        ...


Opener = Callable[[str | int], Capture]
"""Function that opens an address, or a camera by its number."""


def open_capture(address: str | int) -> Capture:
    """Open a file or an address by FFmpeg, or a camera by the system's backend.

    Files go to FFmpeg on every system, since it gives the times of frames and applies rotations.

    Raises:
        VideoError: The address holds bytes that are no letters, on which OpenCV crashes.
    """
    if isinstance(address, int):
        with quiet_opening():
            return cv2.VideoCapture(address)
    try:
        address.encode("utf-8")
    except UnicodeEncodeError as error:
        raise VideoError(
            f"The name {address.encode('utf-8', 'backslashreplace').decode()} holds bytes that are no "
            "letters, which OpenCV cannot open. Rename the file or folder."
        ) from error
    with quiet_opening():
        return cv2.VideoCapture(address, cv2.CAP_FFMPEG)


@contextmanager
def released(capture: Capture) -> Iterator[Capture]:
    """Release a capture at the end of the block."""
    try:
        yield capture
    finally:
        capture.release()


def grabbed(capture: Capture) -> bool:
    """Decode the next frame, without messages; false at the end."""
    with quiet():
        return capture.grab()


def pixels_of(capture: Capture) -> UInt8[np.ndarray, "height width 3"] | None:
    """Convert the frame that was grabbed to RGB, in memory of its own; None if it cannot be converted."""
    with quiet():
        converted, image = capture.retrieve()
    if not converted or image is None:
        return None
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.asarray(cv2.cvtColor(image, code))


def coded_frames(address: str) -> int:
    """Count the coded frames of a file without decoding them; some codecs have a few that are not shown."""
    with quiet_opening():
        capture = cv2.VideoCapture(address, cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    count = 0
    with released(capture):
        while grabbed(capture):
            count += 1
    return count
