"""Small videos, written and changed byte by byte: rotation, times of frames, and what is damaged."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from hand_recon.data.video.capture import Capture
from hand_recon.data.video.quiet import quiet_opening, without_noise

WIDTH, HEIGHT = 64, 48
ROTATIONS: Final = {
    0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0),
}  # fmt: skip
"""Matrices of the box `tkhd` that rotate clockwise by so many degrees."""

_CODECS: Final = {".mp4": "mp4v", ".avi": "MJPG", ".webm": "VP80", ".mkv": "MJPG"}
_ANCESTORS: Final = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def numbered_image(number: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """RGB image whose grey level says its number, with a red corner at the top left."""
    pixels = np.full((height, width, 3), grey_of(number), dtype=np.uint8)
    pixels[: height // 2, : width // 2] = (220, 20, 20)
    return pixels


def grey_of(number: int) -> int:
    """Grey level of a frame, 8 levels apart so that compression keeps them apart.

    Levels repeat after 32 frames: a camera without an end gives more than that before it is closed.
    """
    return 8 * number % 256


def number_of(pixels: np.ndarray) -> int:
    """Number of a frame by the grey level of its lower half."""
    height, width, _ = pixels.shape
    return round(float(pixels[height * 5 // 8 :, width * 5 // 8 :].mean()) / 8)


def write_clip(path: Path, count: int = 12, fps: float = 25.0, **size: int) -> Path:
    """Write numbered images with OpenCV alone, with a codec by the suffix."""
    tag = cv2.VideoWriter.fourcc(*_CODECS[path.suffix])
    shape = numbered_image(0, **size).shape
    with quiet_opening(), without_noise():
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, tag, fps, (shape[1], shape[0]))
    assert writer.isOpened()
    for number in range(count):
        writer.write(numbered_image(number, **size)[..., ::-1])
    writer.release()
    return path


def rotate(path: Path, degrees: int) -> None:
    """Write a rotation into the head of an MP4's track, as telephones do."""
    content = bytearray(path.read_bytes())
    matrix = content.index(b"tkhd") + 4 + 40
    a, b, c, d = (value << 16 for value in ROTATIONS[degrees])
    content[matrix : matrix + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(content)


def set_durations(path: Path, durations: Sequence[float]) -> None:
    """Give each frame of an MP4 its own duration in seconds, in place of a constant one (box `stts`)."""
    content = bytearray(path.read_bytes())
    head = content.index(b"mdhd")
    (scale,) = struct.unpack_from(">I", content, head + 16)
    ticks = [round(duration * scale) for duration in durations]
    table = content.index(b"stts") - 4
    (length,) = struct.unpack_from(">I", content, table)
    entries = b"".join(struct.pack(">II", 1, each) for each in ticks)
    new = struct.pack(">I4sII", 16 + len(entries), b"stts", 0, len(ticks)) + entries
    # The boxes around grow; the frames lie before them, so that their places stay.
    for name in _ANCESTORS:
        place = content.index(name) - 4
        (size,) = struct.unpack_from(">I", content, place)
        struct.pack_into(">I", content, place, size + len(new) - length)
    struct.pack_into(">I", content, head + 20, sum(ticks))
    # The edit list ends the track after as many milliseconds.
    struct.pack_into(">I", content, content.index(b"elst") + 12, round(1000 * sum(durations)))
    content[table : table + length] = new
    path.write_bytes(content)


def cut(path: Path, share: float) -> None:
    """Keep the first part of a file."""
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])


class FakeCapture(Capture):
    """A camera or file in memory: numbered images with times, and properties by OpenCV's numbers."""

    def __init__(
        self,
        times: Sequence[float] = (),
        properties: Mapping[str, float] | None = None,
        *,
        opened: bool = True,
        error_at: int | None = None,
    ) -> None:
        self.times = list(times)
        self.opened = opened
        self.released = 0
        self.error_at = error_at
        self.properties = {getattr(cv2, name): value for name, value in (properties or {}).items()}
        self.position = -1
        self.retrieved: list[int] = []

    def isOpened(self) -> bool:  # noqa: N802
        return self.opened

    def grab(self) -> bool:
        self.position += 1
        if self.position == self.error_at:
            raise cv2.error("the cable was pulled")
        return self.position < len(self.times)

    def retrieve(self) -> tuple[bool, np.ndarray]:
        self.retrieved.append(self.position)
        return True, numbered_image(self.position)[..., ::-1]

    def get(self, propId: int, /) -> float:
        if propId == cv2.CAP_PROP_POS_MSEC:
            return 1000 * self.times[self.position]
        return self.properties.get(propId, 0.0)

    def release(self) -> None:
        self.released += 1
