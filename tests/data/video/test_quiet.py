"""OpenCV and FFmpeg print nothing about videos by themselves, unless the user asks for it."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hand_recon.data.video.quiet import log_levels, quiet, quiet_opening, without_noise
from tests.support.video_files import cut, write_clip

READS = """
import sys
from hand_recon.data.video.files import video_file
from hand_recon.data.video.writer import VideoWriter
for path in sys.argv[2:]:
    try:
        count = len(list(video_file(path)))
    except ValueError:
        pass
with VideoWriter(sys.argv[1]) as video:
    video.write(next(iter(video_file(sys.argv[2]))).pixels, 0.0)
"""


def printed(tmp_path: Path, **environment: str) -> str:
    """Everything that a process prints which reads damaged videos and writes one."""
    clips = [tmp_path / f"cut{suffix}" for suffix in (".avi", ".webm", ".mp4")]
    for clip in clips:
        cut(write_clip(clip, count=20), 0.6)
    clean = {name: value for name, value in os.environ.items() if not name.startswith("OPENCV")}
    done = subprocess.run(  # noqa: S603  # this interpreter, with the script above
        [sys.executable, "-c", READS, tmp_path / "new.webm", *clips],
        capture_output=True, check=True, text=True, timeout=60,
        env={**clean, "OMP_NUM_THREADS": "1", **environment},
    )  # fmt: skip
    assert (tmp_path / "new.webm").exists()
    return done.stdout + done.stderr


def test_damaged_videos_and_new_ones_print_nothing_but_the_warnings_of_this_package(
    tmp_path: Path,
) -> None:
    lines = printed(tmp_path).splitlines()
    assert [line.partition(" ends after")[1] for line in lines] == [" ends after"] * 2


def test_whoever_asks_for_messages_of_ffmpeg_gets_them(tmp_path: Path) -> None:
    assert "OPENCV:FFMPEG" in printed(tmp_path, OPENCV_FFMPEG_LOGLEVEL="16")


def test_the_level_of_messages_is_restored_after_the_last_thread() -> None:
    before = log_levels.getLogLevel()
    assert before != 0
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with quiet():
            inside.set()
            leave.wait(5)

    with quiet():
        thread = threading.Thread(target=other)
        thread.start()
        assert inside.wait(5)
    assert log_levels.getLogLevel() == 0
    leave.set()
    thread.join()
    assert log_levels.getLogLevel() == before


def test_the_environment_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    before = dict(os.environ)
    with quiet_opening():
        assert os.environ["OPENCV_FFMPEG_LOGLEVEL"] == "-8"
    assert dict(os.environ) == before


def test_what_others_print_meanwhile_is_kept(capfd: pytest.CaptureFixture[str]) -> None:
    with without_noise():
        os.write(2, b"OpenCV: FFMPEG: tag 0x30385056/'VP80' is not supported\nfrom elsewhere\n")
    assert capfd.readouterr().err == "from elsewhere\n"
