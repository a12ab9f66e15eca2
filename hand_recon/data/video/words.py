"""Words of the command line that name a video: files, streams, cameras and sequences of images."""

import logging
import math
import re
from enum import Enum
from pathlib import Path
from typing import Final

from hand_recon.data.photos.formats import kind_of_file
from hand_recon.data.video.cameras import SCHEMES, web_video, webcam
from hand_recon.data.video.files import video_file
from hand_recon.data.video.frames import FrameSource, VideoError
from hand_recon.data.video.sequences import (
    Animation,
    is_animation,
    is_numbered,
    numbered_sequence,
    photo_sequence,
)

logger = logging.getLogger(__name__)

VIDEO_SUFFIXES: Final = frozenset(
    [
        ".mp4", ".m4v", ".mov", ".qt", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".m2v", ".vob", ".wmv",
        ".asf", ".3gp", ".3g2", ".ts", ".mts", ".m2ts", ".ogv", ".flv", ".f4v", ".mxf", ".mjpg", ".mjpeg",
        ".h264", ".264", ".h265", ".265", ".hevc", ".ivf", ".y4m", ".dv",
    ]
)  # fmt: skip
"""Suffixes of files that are read as video whatever their content, so that an error says what is wrong."""

_WEBCAM: Final = re.compile(r"webcam(?::(\d{1,3}))?")
_ADDRESS: Final = re.compile(rf"(?:{'|'.join(SCHEMES)})://", re.IGNORECASE)


class VideoKind(Enum):
    """Kinds of words that name a video."""

    FILE = "video file"
    """File with a video's content or suffix."""
    ANIMATION = "animated image"
    """GIF, PNG or WebP of several frames."""
    WEB = "web address"
    """Stream, or video on a server."""
    WEBCAM = "webcam"
    """`webcam`, or `webcam:1` for the second camera."""
    NUMBERED = "numbered images"
    """Images with a number in the place of `%05d`."""
    SEQUENCE = "images with a rate"
    """Folder or pattern of images, with frames per second given."""


def video_kind(word: str | Path, fps: float | None = None) -> VideoKind | None:
    """Tell whether a word names a video, without opening it.

    A file or folder of that name comes first: a folder `webcam` is a folder. A folder and a pattern such as
    `*.png` are photographs unless frames per second are given.

    Args:
        word: Word of the command line; a `Path` is never an address or a camera.
        fps: Frames per second, if the user gave them.

    Returns:
        Kind of video; None for what may be photographs.
    """
    if not str(word) or "\0" in str(word):
        return None
    path = Path(word)
    try:
        if path.is_dir():
            return None if fps is None else VideoKind.SEQUENCE
        if path.exists():
            return _kind_of_existing(path)
    except OSError:
        # A name that is too long, for example, which the reader of photographs refuses in words.
        return None
    return _kind_of_word(str(word), isinstance(word, Path), fps)


def frame_source(word: str | Path, fps: float | None = None) -> FrameSource | None:
    """Open what a word of the command line names as frames of a video.

    Args:
        word: Video file, animated image, web address, `webcam`, `webcam:1`, numbered images such as
            `frames/%05d.png`, or with `fps` a folder or pattern of images.
        fps: Frames per second of a sequence of images; everything else has its own times.

    Returns:
        Source of frames; None if the word names photographs, or nothing that is known here.

    Raises:
        VideoError: It names a video that cannot be read, or `fps` is no positive number.
        PhotoError: The images of a sequence cannot be read.
    """
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise VideoError(f"fps is {fps}; expected frames per second, such as fps=25.")
    kind = video_kind(word, fps)
    if kind in (VideoKind.NUMBERED, VideoKind.SEQUENCE):
        opened = numbered_sequence if kind is VideoKind.NUMBERED else photo_sequence
        return opened(str(word), fps)
    if kind is not None and fps is not None:
        logger.info("fps=%g is for sequences of images; the frames of a %s have their own times.",
                    fps, kind.value)  # fmt: skip
    match kind:
        case VideoKind.FILE:
            return video_file(word)
        case VideoKind.ANIMATION:
            return Animation(word)
        case VideoKind.WEB:
            return web_video(str(word))
        case VideoKind.WEBCAM:
            number = _WEBCAM.fullmatch(str(word))
            return webcam(int((number and number[1]) or 0))
    return None


def _kind_of_existing(path: Path) -> VideoKind | None:
    kind = kind_of_file(path) if path.is_file() else None
    if kind and kind.is_photo and kind.name:
        return VideoKind.ANIMATION if is_animation(path) else None
    if (kind and kind.name == "video") or path.suffix.lower() in VIDEO_SUFFIXES:
        return VideoKind.FILE
    return None


def _kind_of_word(word: str, is_path: bool, fps: float | None) -> VideoKind | None:
    if not is_path and _ADDRESS.match(word):
        return VideoKind.WEB
    if not is_path and _WEBCAM.fullmatch(word):
        return VideoKind.WEBCAM
    if is_numbered(word):
        return VideoKind.NUMBERED
    if Path(word).suffix.lower() in VIDEO_SUFFIXES and not re.search(r"[*?\[]", word):
        return VideoKind.FILE
    if fps is not None and re.search(r"[*?\[]", word):
        return VideoKind.SEQUENCE
    return None
