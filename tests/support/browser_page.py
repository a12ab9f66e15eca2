"""A real headless browser with a fake camera, and the page's command for it."""

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


def browser_file() -> str:
    """Path of Chromium or Chrome; skips the test with the reason where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    found = os.environ.get("HAND_RECON_BROWSER") or next(filter(None, map(shutil.which, names)), "")
    if not found:
        pytest.skip("needs Chromium or Chrome on the PATH, or in $HAND_RECON_BROWSER")
    return found


@contextmanager
def open_browser(camera: Path) -> Iterator[Any]:
    """A headless browser whose camera shows the images of a file.

    Args:
        camera: JPEG images, one behind the other (`.mjpeg`).
    """
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="needs playwright: uv pip install 'hand_recon[browser]'"
    )
    executable = browser_file()
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=executable,
            headless=True,
            args=[
                "--enable-unsafe-swiftshader",
                "--use-fake-device-for-media-stream",
                "--use-fake-ui-for-media-stream",
                f"--use-file-for-fake-video-capture={camera}",
            ],
        )
        try:
            yield browser
        finally:
            browser.close()


def camera_file(path: Path, photograph: Path) -> Path:
    """Write images of 640 × 480 pixels in which a photograph moves back and forth.

    Args:
        path: File to write, with the suffix `.mjpeg`.
        photograph: The photograph.
    """
    original = np.asarray(cv2.imread(str(photograph)))
    image = cv2.resize(original, (480, 480), interpolation=cv2.INTER_CUBIC)
    frames = []
    for angle in np.linspace(0.0, 2 * np.pi, 30, endpoint=False):
        frame = np.full((480, 640, 3), 150, dtype=np.uint8)
        left = 80 + round(20 * float(np.sin(angle)))
        frame[:, left : left + 480] = image
        frames.append(cv2.imencode(".jpg", frame)[1].tobytes())
    path.write_bytes(b"".join(frames))
    return path


@contextmanager
def served(*words: str) -> Iterator[str]:
    """The page of `hand-recon demo` in a process of its own.

    Args:
        *words: The command line after the verb.

    Yields:
        The page's address.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}/"
    command = [sys.executable, "-m", "hand_recon", "demo", *words, f"port={port}"]
    with subprocess.Popen(  # noqa: S603  # our own words
        command, cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as server:
        try:
            _wait(address, server)
            yield address
        finally:
            server.terminate()


def _wait(address: str, server: "subprocess.Popen[str]") -> None:
    """Wait until the page answers.

    Raises:
        RuntimeError: The command ended, or does not answer for two minutes.
    """
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and server.poll() is None:
        try:
            urllib.request.urlopen(address)  # noqa: S310  # our own address
        except urllib.error.URLError:
            time.sleep(0.2)
        else:
            return
    server.terminate()
    raise RuntimeError(f"No page at {address}: {server.stderr.read() if server.stderr else ''}")
