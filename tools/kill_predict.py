"""Kills `hand-recon predict clip.mp4` again and again, and compares what comes out in the end.

    python tools/kill_predict.py clip.mp4 --kills 10

The command runs once to its end, and once more into another folder, where it is killed (SIGKILL) at random
times, each after some of the frames were found or fitted, and repeated. Both files of hands must be the same
byte for byte. The exit status says so.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np


def _command(clip: Path, output: Path, words: Sequence[str]) -> list[str]:
    return [
        sys.executable, "-m", "hand_recon.predict", str(clip), f"output={output}",
        "motion.video=null", "motion.plot=false", *words,
    ]  # fmt: skip


def _progress(output: Path) -> int:
    """Number of frames that were found so far, and 40 for each piece that was fitted."""
    folder = output / "unfinished"
    frames = folder / "frames.jsonl"
    lines = frames.read_bytes().count(b"\n") if frames.exists() else 0
    return lines + 40 * len(list(folder.glob("hand *.npz")))


def _killed(command: Sequence[str], output: Path, more: int, delay: float) -> bool:
    """Run a command, and kill it once it has written so much more; false if it ended before."""
    goal = _progress(output) + more
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)  # noqa: S603  # our own command
    while process.poll() is None:
        if _progress(output) >= goal:
            time.sleep(delay)
            process.send_signal(signal.SIGKILL)
            process.wait()
            return True
        time.sleep(0.01)
    if process.returncode:
        raise SystemExit(f"The command failed with status {process.returncode}.")
    return False


def _hands(output: Path) -> bytes:
    lines, whole = output / "hands.jsonl", output / "hands.json"
    return (lines if lines.exists() else whole).read_bytes()


def main(words: Sequence[str] | None = None) -> None:
    """Kill, repeat and compare.

    Args:
        words: The command line; none for this process's own.

    Raises:
        SystemExit: The results differ, or the command fails.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("overrides", nargs="*", help="further words of hand-recon predict")
    options = parser.parse_args(words)
    random = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, often = Path(folder) / "whole", Path(folder) / "often"
        subprocess.run(_command(options.clip, whole, options.overrides), check=True)  # noqa: S603
        kills, command = 0, _command(options.clip, often, options.overrides)
        frames = _hands(whole).count(b"\n")
        while kills < options.kills:
            more = int(random.integers(1, max(3, 2 * frames // options.kills)))
            if not _killed(command, often, more, random.uniform(0, 0.2)):
                break
            kills += 1
            print(f"killed {kills} times, at {_progress(often)}")
        if (often / "unfinished.json").exists():
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)  # noqa: S603
        same = _hands(whole) == _hands(often)
        print(f"{kills} kills: the files of hands are {'the same' if same else 'different'}.")
    if not same:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
