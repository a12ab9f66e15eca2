"""Pieces of a clip's fit: files that are closed, and processes that end with the command."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.motion.identity import Track
from hand_recon.runs.clip import fitting
from hand_recon.runs.clip.hands_of_clip import HandOfClip

_COMMAND = """
import os, time
from hand_recon.runs.clip.fitting import _pool

def work(number: int) -> int:
    time.sleep(0.1)
    return os.getpid()

if __name__ == "__main__":
    with _pool(2) as pool:
        for number in pool.map(work, range(10_000)):
            print(number, flush=True)
"""


def landmarks_of(count: int) -> ImageLandmarks:
    """Landmarks that nothing looks at."""
    return ImageLandmarks(
        torch.zeros(count, 21, 2, dtype=torch.float64),
        torch.ones(count, 21, dtype=torch.bool),
        torch.zeros(count, dtype=torch.bool),
        ("hand",) * count,
    )


def test_pieces_may_be_more_than_open_files(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    track = Track(1, "right", 1.0, None, np.arange(60), np.arange(60) / 30, np.zeros(60, int), ())
    pieces = []
    for number in range(60):
        columns: dict[str, Any] = {
            "joint_angles": np.full((1, 2, 15, 3), float(number)),
            "root_rotation": np.tile(np.eye(3), (1, 2, 1, 1)),
            "place": np.zeros((1, 2, 3)),
            "certainty": np.ones((1, 2)),
            "cost": np.zeros((1, 2)),
        }
        path = tmp_path / f"{number}.npz"
        np.savez(path, **columns)
        pieces.append(fitting._Piece(path, landmarks_of(1), torch.zeros(10)))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/dev/fd")) + 30, hard))
    try:
        found = fitting._estimates(HandOfClip(track, landmarks_of(60), ()), pieces)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    np.testing.assert_array_equal(found.joint_angles[:, 0, 0, 0], np.arange(60))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX's")
def test_processes_end_when_the_command_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "command.py"
    script.write_text(_COMMAND)
    with subprocess.Popen(  # noqa: S603
        [sys.executable, str(script)], stdout=subprocess.PIPE
    ) as command:
        assert command.stdout is not None
        worker = int(command.stdout.readline())
        os.kill(worker, 0)
        command.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 20
    while _is_alive(worker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _is_alive(worker)


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
