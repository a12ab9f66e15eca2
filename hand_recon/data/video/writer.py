"""Videos that are written: constant rate, a codec by the suffix, nothing overwritten (decision 79)."""

import logging
import math
import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import cv2
import numpy as np
from jaxtyping import UInt8

from hand_recon.data.photos.formats import shown
from hand_recon.data.video.capture import coded_frames
from hand_recon.data.video.frames import ASSUMED_RATE, VideoError
from hand_recon.data.video.quiet import quiet_opening, without_noise

logger = logging.getLogger(__name__)

CODECS: Final[dict[str, tuple[str, ...]]] = {
    ".webm": ("VP80", "VP90"),
    ".mp4": ("mp4v",),
    ".avi": ("MJPG",),
}
"""Codecs of each suffix, by preference (decision 79). Browsers play WebM, and no MP4 with `mp4v`, which
players do."""

_NAMES: Final = {"VP90": "VP9", "VP80": "VP8", "mp4v": "MPEG-4", "MJPG": "Motion JPEG"}


class VideoWriter:
    """A video file with a constant rate, made of frames with any increasing times.

    Each frame is shown from the tick nearest to its time until that of the next frame: frames repeat where
    their times are far apart, and of several frames with one tick the nearest is kept, of two equally near
    ones the later. The last frame lasts one tick. The file is written under another name beside its own, and
    renamed when it is complete; nothing is left of it if the block of `with` ends with an error.

        with VideoWriter("hands.webm", fps=25) as video:
            video.write(pixels, time)
    """

    def __init__(
        self, path: str | Path, fps: float | None = None, codecs: Sequence[str] | None = None
    ) -> None:
        """Check name, rate and place; the file is begun with the first frame.

        Args:
            path: File, whose suffix decides the format: `.webm` (VP8), `.mp4` (MPEG-4) or `.avi` (MJPG).
            fps: Frames per second of the file, rounded to two decimals, which every format keeps exactly;
                30 for None.
            codecs: Codecs to try, by OpenCV's four letters; None for those of the suffix.

        Raises:
            VideoError: The suffix is not one of these, or the rate is no positive number.
            FileExistsError: There is such a file already.
            FileNotFoundError: There is no such folder.
        """
        self.path = Path(path)
        self.fps = _checked_rate(fps)
        self.codec = ""
        """Four letters of the codec that is written; "" before the first frame."""
        self.count = 0
        """Number of frames in the file, with repeated ones."""
        self._codecs = _codecs_of(self.path) if codecs is None else tuple(codecs)
        _check_place(self.path)
        self._new = self.path.with_name(
            f".{self.path.stem}.{secrets.token_hex(4)}{self.path.suffix.lower()}"
        )
        self._writer: cv2.VideoWriter | None = None
        self._shape = (0, 0)
        self._start = 0.0
        self._last = -math.inf
        self._waiting: tuple[float, np.ndarray] | None = None
        """Time in ticks since the first frame, and BGR pixels, of the frame that is shown next."""

    def write(self, pixels: UInt8[np.ndarray, "height width 3"], time: float) -> None:
        """Add a frame.

        Args:
            pixels: sRGB, all frames of one size. An odd last row or column is left out, since the formats
                have sides of even length.
            time: Seconds, later than that of the frame before.

        Raises:
            ValueError: The size changes, is below 2 × 2, or the time does not increase.
            VideoError: None of the codecs can be written.
        """
        if self._waiting is None:
            self._begin(pixels.shape[:2], time)
        self._check_frame(pixels, time)
        self._last = time
        image = cv2.cvtColor(_even(pixels), cv2.COLOR_RGB2BGR)
        ticks = (time - self._start) * self.fps
        if self._waiting is not None:
            earlier, _ = self._waiting
            repeats = _tick(ticks) - _tick(earlier)
            self._show(repeats)
            if repeats == 0 and abs(earlier - _tick(earlier)) < abs(ticks - _tick(ticks)):
                # The frame that waits is nearer to the tick; only its time is that of the later one.
                return
        self._waiting = ticks, image

    def close(self) -> None:
        """Complete the file and give it its name; without a frame there is none, with a warning.

        Raises:
            VideoError: The file holds fewer frames than were written, as on a full disk.
            FileExistsError: Another program made a file of that name meanwhile; the message names this one.
        """
        if self._writer is None:
            if self.count == 0:
                logger.warning("%s is not written, since there is no frame.", shown(self.path))
            return
        self._show(1)
        self._release()
        try:
            _check_whole(self._new, self.path, self.count)
        except VideoError:
            self._new.unlink(missing_ok=True)
            raise
        _move(self._new, self.path)

    def discard(self) -> None:
        """Remove what was written."""
        self._release()
        self._new.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
        else:
            self.discard()

    def _begin(self, shape: tuple[int, ...], start: float) -> None:
        height, width = shape
        if min(height, width) < 2:
            raise ValueError(f"A frame has {width} × {height} pixels; expected at least 2 × 2.")
        size = width // 2 * 2, height // 2 * 2
        failed: list[str] = []
        for codec in self._codecs:
            self._writer = _opened(self._new, codec, self.fps, size)
            if self._writer is not None:
                self.codec, self._shape, self._start = codec, (height, width), start
                _say_codec(self.path, codec, failed)
                return
            failed.append(codec)
        self._new.unlink(missing_ok=True)
        raise VideoError(
            f"Cannot write {shown(self.path)}: this OpenCV has none of the codecs {', '.join(failed)} for "
            f"it, or the folder cannot be written. Choose another suffix: {', '.join(CODECS)}."
        )

    def _check_frame(self, pixels: np.ndarray, time: float) -> None:
        if pixels.shape[:2] != self._shape:
            raise ValueError(
                f"A frame has {pixels.shape[1]} × {pixels.shape[0]} pixels, and the first one had "
                f"{self._shape[1]} × {self._shape[0]}; a video has one size."
            )
        if not math.isfinite(time) or time <= self._last:
            raise ValueError(
                f"A frame has the time {time} s after one of {self._last} s; expected increasing times."
            )

    def _show(self, times: int) -> None:
        if self._writer is None or self._waiting is None:
            return
        for _ in range(times):
            self._writer.write(self._waiting[1])
            self.count += 1

    def _release(self) -> None:
        if self._writer is not None:
            self._writer.release()
        self._writer = self._waiting = None


def _tick(ticks: float) -> int:
    """Nearest whole number; the later one of two that are equally near."""
    return math.floor(ticks + 0.5)


def _even(pixels: np.ndarray) -> np.ndarray:
    height, width = (side // 2 * 2 for side in pixels.shape[:2])
    return np.ascontiguousarray(pixels[:height, :width])


def _checked_rate(fps: float | None) -> float:
    rate = round(ASSUMED_RATE if fps is None else fps, 2)
    if not (math.isfinite(rate) and 0 < rate <= 1000):
        raise VideoError(f"The rate is {fps}; expected frames per second, such as fps=25.")
    return rate


def _codecs_of(path: Path) -> tuple[str, ...]:
    codecs = CODECS.get(path.suffix.lower())
    if codecs is None:
        raise VideoError(
            f"{shown(path)} has the suffix {path.suffix!r}; videos are written as {', '.join(CODECS)}. "
            "Change its name."
        )
    return codecs


def _check_place(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(
            f"{shown(path)} exists already, and is not overwritten. Name another file, or remove it first."
        )
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"There is no folder {shown(path.parent)} for {shown(path.name)}. Make it first."
        )


def _opened(path: Path, codec: str, fps: float, size: tuple[int, int]) -> cv2.VideoWriter | None:
    # FFmpeg takes what is before a colon in a relative path for a protocol.
    address, tag = str(path.absolute()), cv2.VideoWriter.fourcc(*codec)
    with quiet_opening(), without_noise():
        writer = cv2.VideoWriter(address, cv2.CAP_FFMPEG, tag, fps, size)
    return writer if writer.isOpened() else None


def _say_codec(path: Path, codec: str, failed: Sequence[str]) -> None:
    instead = f" This OpenCV cannot write {' or '.join(failed)}." if failed else ""
    logger.info(
        "%s is written as %s (%s).%s", shown(path), _NAMES.get(codec, codec), codec, instead
    )


def _check_whole(new: Path, path: Path, expected: int) -> None:
    """Count the frames in the file, since OpenCV's writer reports no error.

    The head alone does not do: its number of frames is right in a file whose end is missing.
    """
    found = coded_frames(str(new.absolute()))
    if found < expected:
        raise VideoError(
            f"{shown(path)} could not be written whole: it holds {found} of {expected} frames. The disk may "
            "be full; make space, or name another folder."
        )


def _move(new: Path, path: Path) -> None:
    """Rename without overwriting, by a second name where the file system has them."""
    try:
        os.link(new, path)
    except FileExistsError:
        raise FileExistsError(
            f"{shown(path)} was made by another program meanwhile, and is not overwritten. The video is "
            f"{shown(new)}."
        ) from None
    except OSError:
        _check_place(path)
        new.rename(path)
    else:
        new.unlink()
