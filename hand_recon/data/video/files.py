"""Video files, and finite videos at web addresses."""

import logging
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import cv2

from hand_recon.data.photos.formats import kind_of_file, shown
from hand_recon.data.video.capture import (
    Capture,
    Opener,
    grabbed,
    open_capture,
    pixels_of,
    released,
)
from hand_recon.data.video.frames import ASSUMED_RATE, Frame, FrameSource, VideoError
from hand_recon.data.video.times import Clock
from hand_recon.reading.limits import LIMITS, too_large

logger = logging.getLogger(__name__)

CONVERSION: Final = "ffmpeg -i <video> -c:v libx264 converted.mp4"
"""Command that converts a video to one that OpenCV reads everywhere."""

_FASTEST: Final = 1000.0
"""Frames per second from which on a container's number is taken for its unit of time, as in WebM."""
_AV1: Final = "av01"


class VideoFile(FrameSource):
    """A video with an end: every frame, with its own time, upright.

    Frames are read anew by each iteration, which holds the file open until it ends.
    """

    def __init__(self, address: str, name: str, opener: Opener = open_capture) -> None:
        """Read the head and the first frame.

        Args:
            address: Absolute path, or a web address.
            name: Name for messages.
            opener: Function that opens the address.

        Raises:
            VideoError: It has no video track, or no frame that can be decoded.
        """
        self.name = name
        self._address = address
        self._opener = opener
        with released(self._opened()) as capture:
            _refuse_huge_frames(name, capture)
            first = pixels_of(capture) if grabbed(capture) else None
            if first is None:
                raise VideoError(_without_frames(name, capture))
            self.size = (first.shape[1], first.shape[0])
            self.rate_hint = rate_of(capture)
            self.count_hint = count_of(capture)
            _note_shape_of_pixels(name, capture)

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """Iterate over the frames until the file gives no more; see `FrameSource.frames`."""
        clock = Clock(1 / (self.rate_hint or ASSUMED_RATE))
        number = 0
        with released(self._opened()) as capture:
            while grabbed(capture):
                time = clock.time(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
                pixels = pixels_of(capture) if number >= first else None
                if pixels is not None:
                    yield Frame(number, time, pixels)
                number += 1
        self._report(number, clock.repaired)

    def _opened(self) -> Capture:
        capture = self._opener(self._address)
        if not capture.isOpened():
            capture.release()
            raise VideoError(
                f"{self.name} has no video track that can be read; it may hold sound alone, be damaged, or "
                f"have a format that is not known. If a player shows it, convert it: {CONVERSION}."
            )
        return capture

    def _report(self, count: int, repaired: int) -> None:
        """Say what was repaired, and what is missing by more than a container's number may be wrong."""
        if repaired:
            logger.info(
                "%s has %d frames without a time, or with one that is not later than the time before; each "
                "is put %.1f ms after the frame before.",
                self.name, repaired, 1000 / (self.rate_hint or ASSUMED_RATE),
            )  # fmt: skip
        expected = self.count_hint or 0
        if expected - count > max(2, 0.02 * expected):
            logger.warning(
                "%s ends after %d frames; its head promises %d. It was cut off or is damaged: copy or "
                "download it again if the rest is needed.",
                self.name, count, expected,
            )  # fmt: skip


def video_file(path: str | Path) -> VideoFile:
    """Open a video file by its path.

    Raises:
        VideoError: There is no such file, or it is no video that can be read; the message says which.
    """
    path = Path(path)
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise VideoError(f"{shown(path)} is a folder; expected a video. Name a file in it.")
        if not stat.S_ISREG(mode):
            raise VideoError(
                f"{shown(path)} is no ordinary file; expected a video. Save it as a file first."
            )
        _refuse_what_is_no_video(path)
    except FileNotFoundError:
        raise VideoError(
            f"No file at {shown(path)}; expected a video. Check the name and the folder."
        ) from None
    except OSError as error:
        raise VideoError(
            f"Cannot open {shown(path)}: {error.strerror}. Check its name and permissions."
        ) from error
    # FFmpeg takes what is before a colon in a relative path for a protocol.
    return VideoFile(str(path.absolute()), shown(path))


def _refuse_huge_frames(name: str, capture: Capture) -> None:
    """Refuse a video by the size of its frames that its head announces, before one is decoded."""
    width, height = (
        capture.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    if width * height > LIMITS.frame_pixels:
        raise VideoError(too_large(name, round(width * height), "frame_pixels", "pixels a frame"))


def rate_of(capture: Capture) -> float | None:
    """Mean frames per second by the container or camera; None if it is missing or impossible."""
    rate = capture.get(cv2.CAP_PROP_FPS)
    return rate if 0 < rate < _FASTEST else None


def count_of(capture: Capture) -> int | None:
    """Number of frames by the container; None if it does not say, as for live streams."""
    count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    return int(count) if 0 < count < 1e9 else None


def _refuse_what_is_no_video(path: Path) -> None:
    kind = kind_of_file(path)
    if kind.name == "empty":
        raise VideoError(f"{shown(path)} is empty (0 bytes). Copy or download it again.")
    if kind.name in ("text", "HTML", "SVG", "PDF", "ZIP"):
        what = {"HTML": "a web page, perhaps saved in place of the video", "text": "text"}
        raise VideoError(
            f"{shown(path)} is {what.get(kind.name, f'a file of the kind {kind.name}')}; expected a video. "
            "Name or download the video itself."
        )
    if kind.name == "video" and _lacks_index(path):
        raise VideoError(
            f"{shown(path)} was cut off: it lacks the index (moov), which is written last. Copy or download "
            "it again; if its recording was broken off, a tool such as untrunc may repair it."
        )


def _lacks_index(path: Path) -> bool:
    """True for an ISO base media file (MP4, MOV) without a whole outermost box `moov`."""
    length = path.stat().st_size
    with path.open("rb") as stream:
        position = 0
        while position < length:
            stream.seek(position)
            head = stream.read(16)
            if position == 0 and head[4:8] != b"ftyp":
                return False
            size = int.from_bytes(head[:4], "big")
            # The size 1 stands for one of 64 bits, and 0 for the rest of the file.
            size = int.from_bytes(head[8:16], "big") if size == 1 else size
            size = size if size >= 8 else length - position
            if head[4:8] == b"moov":
                return position + size > length
            position += size
    return True


def _without_frames(name: str, capture: Capture) -> str:
    codec = _codec(capture)
    if codec == _AV1:
        return (
            f"{name} is an AV1 video, which this OpenCV does not decode. Convert it to H.264, for example "
            f"by {CONVERSION}."
        )
    return (
        f"{name} opens as a video (codec {codec}), but no frame of it can be decoded; it is damaged, or "
        f"its codec is not known to this OpenCV. If a player shows it, convert it: {CONVERSION}."
    )


def _codec(capture: Capture) -> str:
    tag = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    letters = tag.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ")
    return letters.lower() if letters.isprintable() and letters else f"0x{tag:08x}"


def _note_shape_of_pixels(name: str, capture: Capture) -> None:
    wide, high = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    if wide > 0 and high > 0 and abs(wide / high - 1) > 0.02:
        logger.warning(
            "%s has pixels that are %.2f times as wide as high, and hands in it look squeezed. Convert it to "
            "square pixels: ffmpeg -i <video> -vf scale=iw*sar:ih,setsar=1 converted.mp4.",
            name, wide / high,
        )  # fmt: skip
