"""Webcams by number, and videos and live streams by web address."""

import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from hand_recon.data.video.capture import Opener, open_capture
from hand_recon.data.video.files import VideoFile, count_of
from hand_recon.data.video.frames import FrameSource, VideoError
from hand_recon.data.video.live import LiveSource

SCHEMES: Final = ("rtsp", "rtsps", "rtmp", "rtmps", "http", "https", "udp", "tcp", "rtp", "srt")
"""Schemes of addresses that are read as video."""

_ALWAYS_LIVE: Final = ("rtsp", "rtsps", "rtmp", "rtmps", "udp", "tcp", "rtp", "srt")


def webcam(
    number: int = 0,
    *,
    opener: Opener = open_capture,
    system: str = sys.platform,
    devices: Path = Path("/dev"),
) -> LiveSource:
    """Open a camera of this machine.

    Args:
        number: Number of the camera, from 0.
        opener: Function that opens it.
        system: Name of the operating system as in `sys.platform`, for messages.
        devices: Folder of Linux's devices.

    Raises:
        VideoError: There is no such camera, or it may not or cannot be used.
    """
    capture = opener(number)
    if capture.isOpened():
        return LiveSource("webcam" if number == 0 else f"webcam:{number}", capture)
    capture.release()
    if system.startswith("linux"):
        raise VideoError(_reason_on_linux(number, devices))
    privacy = {
        "darwin": "allow the terminal to use the camera (System Settings, Privacy & Security, Camera)",
        "win32": "allow desktop apps to use the camera (Settings, Privacy & security, Camera)",
    }.get(system, "check the system's permissions for cameras")
    raise VideoError(
        f"Cannot open camera {number}. Connect a camera, {privacy}, close other programs that use it, or "
        f"name another one: webcam:{number + 1}."
    )


def web_video(address: str, *, opener: Opener = open_capture) -> FrameSource:
    """Open a web address: a live stream, or a file on a server, which is read whole and in order.

    Raises:
        VideoError: Nothing answers, or it is no video.
    """
    name = without_password(address)
    capture = opener(address)
    if not capture.isOpened():
        capture.release()
        raise VideoError(
            f"{name} cannot be opened as a video. Check the address, the network, and the user and password "
            "(scheme://user:password@host/path); a page that shows a video is no video itself."
        )
    if urlsplit(address).scheme.lower() in _ALWAYS_LIVE or count_of(capture) is None:
        return LiveSource(name, capture)
    capture.release()
    return VideoFile(address, name, opener)


def without_password(address: str) -> str:
    """Write an address without its password, for messages and names of files.

    >>> without_password("rtsp://me:secret@10.0.0.2:554/stream")
    'rtsp://me:…@10.0.0.2:554/stream'
    """
    parts = urlsplit(address)
    user, at, host = parts.netloc.rpartition("@")
    if ":" not in user:
        return address
    return parts._replace(netloc=f"{user.partition(':')[0]}:…{at}{host}").geturl()


def _reason_on_linux(
    number: int, devices: Path, may_read: Callable[[Path, int], bool] = os.access
) -> str:
    device = devices / f"video{number}"
    if not device.exists():
        others = _numbers(devices.glob("video*"))
        cure = f"Name one that there is: {', '.join(f'webcam:{k}' for k in others)}." if others else (
            "Connect one; in a container or a virtual machine, pass the device on, or name a video file."
        )  # fmt: skip
        return f"There is no camera {number}: {device} does not exist. {cure}"
    if not may_read(device, os.R_OK | os.W_OK):
        return (
            f"This user may not read {device}. Become a member of its group: sudo usermod -aG video $USER, "
            "then log in again."
        )
    return (
        f"Cannot open {device}. Another program may use the camera: close it. If it is no camera, name "
        f"another one, such as webcam:{number + 1}."
    )


def _numbers(devices: Iterable[Path]) -> list[int]:
    found = (path.name.removeprefix("video") for path in devices)
    return sorted(int(number) for number in found if number.isdecimal())
