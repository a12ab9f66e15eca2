"""Commands as processes on a disk that is full, in a folder that is read-only, and interrupted by Ctrl-C.

The full disk is a file system in memory of a few hundred kilobytes, which only root can mount; permissions
do not bind root, so the read-only folder is one that is mounted so.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.photo_folder import QUICK, read

pytestmark = pytest.mark.slow

KILOBYTES = 300
MINUTES = 5 * 60
PREDICT = (
    "predict", "photos", "detector=landmarks", "detector.landmarks=found.json", "output=disk/out",
    "results.meshes=glb", *QUICK,
)  # fmt: skip
FIT = ("fit", "found.json", "intrinsics=K.json", "output=disk/out", *QUICK)
TRAIN = ("train", "+experiment=smoke", "paths.output=disk", "paths.cache=cache", "threads=1")

Mount = Callable[..., None]


@pytest.fixture
def mount(folder: Path) -> Iterator[Mount]:
    """Function that mounts a file system in memory at `disk`, with options of `mount`."""
    disk = folder / "disk"
    disk.mkdir()
    program = shutil.which("mount")
    if program is None or not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("only root can mount a disk of a few hundred kilobytes")

    def mounted(*options: str) -> None:
        words = [program, "-t", "tmpfs", "-o", ",".join(options), "tmpfs", str(disk)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            pytest.skip(f"no file system in memory can be mounted here: {done.stderr.strip()}")

    try:
        yield mounted
    finally:
        subprocess.run([shutil.which("umount") or "umount", disk], check=False, capture_output=True)  # noqa: S603


def run(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a command in a folder, with one thread."""
    return subprocess.run(  # noqa: S603  # our own words
        [sys.executable, "-m", "hand_recon", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=MINUTES,
    )


def fill(disk: Path, kilobytes: int) -> Path:
    """Take all but a few kilobytes of a disk."""
    taken = disk / "taken"
    taken.write_bytes(b"1" * 1024 * (KILOBYTES - kilobytes))
    return taken


@pytest.mark.parametrize("words", [PREDICT, FIT, TRAIN], ids=["predict", "fit", "train"])
def test_a_full_disk_is_told_without_a_traceback(
    folder: Path, mount: Mount, words: tuple[str, ...]
) -> None:
    mount(f"size={KILOBYTES}k")
    fill(folder / "disk", 30)
    done = run(folder, *words)
    assert done.returncode == 1
    assert "error: The disk is full" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_prediction_goes_on_when_there_is_room_again(folder: Path, mount: Mount) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    mount(f"size={KILOBYTES}k")
    taken = fill(folder / "disk", 30)
    assert run(folder, *PREDICT).returncode == 1
    taken.unlink()
    subprocess.run(  # noqa: S603
        [shutil.which("mount") or "mount", "-o", "remount,size=50m", folder / "disk"], check=True
    )
    done = run(folder, *PREDICT)
    assert done.returncode == 0, done.stderr
    assert len(read(folder / "disk" / "out")) == 3


NO_FOLDER = "cannot be made (Read-only file system). Name another one with output=…."


@pytest.mark.parametrize(
    ("words", "told"),
    [(PREDICT, NO_FOLDER), (FIT, NO_FOLDER), (TRAIN, "The disk can only be read")],
    ids=["predict", "fit", "train"],
)
def test_a_read_only_disk_is_told_without_a_traceback(
    folder: Path, mount: Mount, words: tuple[str, ...], told: str
) -> None:
    mount("ro")
    done = run(folder, *words)
    assert done.returncode == 1
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_an_interrupted_prediction_says_so_and_goes_on(folder: Path) -> None:
    (folder / "photos" / "4 cut off.png").unlink()
    # Long enough that the command is still at work when it is interrupted, on a busy machine too.
    longer = (*PREDICT, "descent.steps=2000", "descent.starts=4")
    words = [sys.executable, "-m", "hand_recon", *longer]
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True) as process:  # noqa: S603
        out, ends = folder / "disk" / "out", time.monotonic() + MINUTES
        while not (out / "unfinished.json").exists() and time.monotonic() < ends:
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=MINUTES)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "Interrupted. What was finished until then is kept."
    assert "Traceback" not in said
    done = run(folder, *longer)
    assert done.returncode == 0, done.stderr
    assert len(read(out)) == 3
