"""Silence for OpenCV and FFmpeg, whose messages about videos go to the terminal by themselves.

What matters in them becomes an error or a warning of this package. Messages are kept if the user asks for
them by one of OpenCV's variables, such as OPENCV_LOG_LEVEL or OPENCV_FFMPEG_LOGLEVEL.
"""

import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import cv2

log_levels: Final[Any] = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
"""Module with `getLogLevel` and `setLogLevel`: OpenCV 4 and 5 have them in different places."""

_ASKED_BY: Final = (
    "OPENCV_LOG_LEVEL",
    "OPENCV_FFMPEG_LOGLEVEL",
    "OPENCV_FFMPEG_DEBUG",
    "OPENCV_VIDEOIO_DEBUG",
    "OPENCV_VIDEOCAPTURE_DEBUG",
    "OPENCV_VIDEOWRITER_DEBUG",
)
_ASKED: Final = any(name in os.environ for name in _ASKED_BY)
_FFMPEG_LEVEL: Final = "OPENCV_FFMPEG_LOGLEVEL"
_SILENT: Final = 0
"""OpenCV's level of messages at which there are none."""
_QUIET: Final = "-8"
"""FFmpeg's level of messages at which there are none."""
_NOISE: Final = b"OpenCV: FFMPEG:"
"""Beginning of the lines that OpenCV's writer prints whatever the level is."""


class _Silence:
    """OpenCV's level of messages, which is the process's, lowered while at least one thread asks for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._asking = 0
        self._before = _SILENT

    def begin(self) -> None:
        with self._lock:
            if self._asking == 0:
                self._before = log_levels.setLogLevel(_SILENT)
            self._asking += 1

    def end(self) -> None:
        with self._lock:
            self._asking -= 1
            if self._asking == 0:
                log_levels.setLogLevel(self._before)


_silence = _Silence()
_opening = threading.Lock()


@contextmanager
def quiet() -> Iterator[None]:
    """Silence OpenCV's log, for the reading of one frame."""
    if _ASKED:
        yield
        return
    _silence.begin()
    try:
        yield
    finally:
        _silence.end()


@contextmanager
def quiet_opening() -> Iterator[None]:
    """Silence OpenCV and FFmpeg while a video is opened; FFmpeg stays silent until the next one is.

    OpenCV reads FFmpeg's level from the environment whenever it opens a video.
    """
    if _ASKED:
        yield
        return
    with _opening, quiet():
        os.environ[_FFMPEG_LEVEL] = _QUIET
        try:
            yield
        finally:
            del os.environ[_FFMPEG_LEVEL]


@contextmanager
def without_noise() -> Iterator[None]:
    """Hold back what the process prints to stderr, and print it afterwards without OpenCV's remarks on tags.

    Opening a writer prints `OpenCV: FFMPEG: tag … is not supported` for WebM, where no codec has a tag.
    """
    try:
        sys.stderr.flush()
        own = os.dup(2)
    except (OSError, AttributeError):
        # A process without a terminal may have no stderr.
        yield
        return
    with tempfile.TemporaryFile() as held:
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(own, 2)
            os.close(own)
            held.seek(0)
            kept = [line for line in held if not line.startswith(_NOISE)]
            if kept:
                os.write(2, b"".join(kept))
