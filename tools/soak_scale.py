"""Kills workers and commands of `hand-recon predict engine=daft`, and measures two workers against one.

    OMP_NUM_THREADS=1 python tools/soak_scale.py photos --images 192 --kills 6 --rounds 3

The command runs once to its end, and once more into another folder, where now a worker and now the command
itself is killed (SIGKILL) at random times; a command that was killed is repeated. Both tables must have the
same rows, none twice, with the same numbers. Then runs with one and with two workers alternate, and the
medians of their rates are compared: images per second between the first and the last part file, without the
start. The exit status is 1 where rows differ, where fewer processes were killed than asked for, or where the
ratio is below `--ratio`.
"""

import argparse
import contextlib
import itertools
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

SUFFIXES = (".jpg", ".jpeg", ".png")
"""Endings of photographs."""

PATIENCE = 900.0
"""Longest time of one command, seconds."""

NUMBERS = ("kp2d", "kp3d", "joint_angles_degrees", "covariance_3d")
"""Numbers of hands that are compared."""


def copied(source: Path, folder: Path, count: int) -> Path:
    """Fill a folder with copies of photographs, as often as needed.

    Args:
        source: Folder of photographs.
        folder: Folder to make.
        count: Number of copies.
    """
    photos = sorted(path for path in source.rglob("*") if path.suffix.lower() in SUFFIXES)
    if not photos:
        raise SystemExit(f"{source} has no photographs; expected {', '.join(SUFFIXES)}.")
    folder.mkdir()
    for number, photo in enumerate(itertools.islice(itertools.cycle(photos), count)):
        # Links to one file would be one photograph.
        shutil.copyfile(photo, folder / f"{number:06d}{photo.suffix}")
    return folder


def command(photos: Path, output: Path, words: Sequence[str]) -> list[str]:
    """Words of a command that reconstructs the photographs."""
    return [
        sys.executable, "-m", "hand_recon.predict", str(photos), "engine=daft", f"output={output}", *words,
    ]  # fmt: skip


def parts_of(output: Path) -> list[Path]:
    """Part files that are there."""
    return sorted((output / "hands").glob("part-*.parquet"))


def workers_of(process: int) -> list[int]:
    """Processes of Daft's workers among the children of a command."""
    found = []
    for children in Path(f"/proc/{process}/task").glob("*/children"):
        found += [int(child) for child in _text(children).split()]
    return sorted(one for one in set(found) if "udf_worker" in _text(Path(f"/proc/{one}/cmdline")))


def _text(path: Path) -> str:
    """Text of a file about a process; empty if the process has ended meanwhile."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""


def until(output: Path, goal: int, process: subprocess.Popen[bytes]) -> bool:
    """Wait until so many part files are there; false if the command ends before."""
    start = time.monotonic()
    while process.poll() is None:
        if len(parts_of(output)) >= goal and workers_of(process.pid):
            return True
        if time.monotonic() - start > PATIENCE:
            process.kill()
            raise SystemExit(f"No part {goal} within {PATIENCE:.0f} s.")
        time.sleep(0.02)
    return False


def kill_worker(process: subprocess.Popen[bytes]) -> bool:
    """Kill a worker of a command; false if there is none any more."""
    for worker in workers_of(process.pid)[:1]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)
            return True
    return False


def kill_and_continue(
    words: Sequence[str], output: Path, kills: int, random: np.random.Generator
) -> tuple[int, int]:
    """Run a command to its end, with kills of workers and of the command itself in turn.

    Args:
        words: The command.
        output: Folder of its results.
        kills: Number of kills.
        random: Source of the moments.

    Returns:
        Numbers of workers and of commands that were killed.
    """
    killed = [0, 0]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)  # noqa: S603  # our own command
    while sum(killed) < kills:
        if not until(output, len(parts_of(output)) + 1, process):
            break
        time.sleep(float(random.uniform(0, 0.5)))
        if sum(killed) % 2 == 0:
            killed[0] += kill_worker(process)
            continue
        if process.poll() is not None:
            break
        process.kill()
        process.wait()
        killed[1] += 1
        process = subprocess.Popen(words, stderr=subprocess.DEVNULL)  # noqa: S603
    if process.wait(PATIENCE):
        raise SystemExit(f"The command ended with status {process.returncode}.")
    return killed[0], killed[1]


def require(killed: tuple[int, int], wanted: int) -> None:
    """Check that all kills took place.

    Args:
        killed: Numbers of workers and of commands that were killed.
        wanted: Number of kills that were asked for.

    Raises:
        SystemExit: Some did not.
    """
    if sum(killed) < wanted:
        raise SystemExit(
            f"Found {sum(killed)} kills; expected {wanted}. The command ended before the others: give more "
            "--images, a smaller --part or fewer --kills."
        )


def table_of(output: Path) -> dict[int, dict[str, Any]]:
    """Rows of all parts by their numbers; a row that is there twice ends the program."""
    import pyarrow.parquet

    rows: dict[int, dict[str, Any]] = {}
    for part in parts_of(output):
        for row in pyarrow.parquet.read_table(part).to_pylist():
            if row["row"] in rows:
                raise SystemExit(f"Row {row['row']} is there twice.")
            rows[row["row"]] = row
    return rows


def difference(first: dict[int, dict[str, Any]], second: dict[int, dict[str, Any]]) -> float:
    """Greatest relative difference of two tables' numbers; tables with other rows end the program."""
    if first.keys() != second.keys():
        raise SystemExit(
            f"{len(first.keys() ^ second.keys())} rows are in one of two tables alone."
        )
    greatest = 0.0
    for number, row in first.items():
        other = second[number]
        if (row["path"], row["error"]) != (other["path"], other["error"]):
            raise SystemExit(f"Row {number} is of another image, or has another error.")
        if len(row["hands"] or ()) != len(other["hands"] or ()):
            raise SystemExit(f"Row {number} has another number of hands.")
        for mine, theirs in zip(row["hands"] or (), other["hands"] or (), strict=True):
            for key in NUMBERS:
                a, b = (np.asarray(one[key] or 0.0, dtype=float) for one in (mine, theirs))
                greatest = max(greatest, float(np.abs(a - b).max() / max(np.abs(a).max(), 1e-9)))
    return greatest


def steady_rate(output: Path, size: int) -> float:
    """Images per second between the first and the last part file, without the start of the processes."""
    times = sorted(part.stat().st_mtime for part in parts_of(output))
    return (len(times) - 1) * size / (times[-1] - times[0])


def measured(photos: Path, folder: Path, rounds: int, part: int) -> dict[int, list[float]]:
    """Rates of one and of two workers, in turn."""
    rates: dict[int, list[float]] = {1: [], 2: []}
    for number in range(rounds):
        for workers in (1, 2):
            output = folder / f"rate {number} {workers}"
            words = command(photos, output, [f"workers={workers}", f"part={part}", f"batch={part}"])
            subprocess.run(words, check=True, stderr=subprocess.DEVNULL)  # noqa: S603
            rates[workers].append(steady_rate(output, part))
            print(
                f"workers={workers}: {rates[workers][-1]:.2f} images per second, load "
                f"{os.getloadavg()[0]:.1f}",
                flush=True,
            )
    return rates


def main(words: Sequence[str] | None = None) -> None:
    """Kill, continue, compare and measure.

    Args:
        words: The command line; none for this process's own.

    Raises:
        SystemExit: Rows are lost, doubled or different, a command fails, or two workers are too slow.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("photos", type=Path, nargs="?", default=Path("examples"))
    parser.add_argument("--images", type=int, default=96)
    parser.add_argument("--part", type=int, default=8)
    parser.add_argument("--kills", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=3, help="runs with each number of workers")
    parser.add_argument("--ratio", type=float, default=1.8)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        photos = copied(options.photos, folder / "photos", options.images)
        if options.kills:
            settings = [f"part={options.part}", f"batch={options.part}", "workers=2"]
            whole, often = folder / "whole", folder / "often"
            subprocess.run(command(photos, whole, settings), check=True)  # noqa: S603
            random = np.random.default_rng(options.seed)
            killed = kill_and_continue(
                command(photos, often, settings), often, options.kills, random
            )
            apart = difference(table_of(whole), table_of(often))
            print(
                f"{killed[0]} workers and {killed[1]} commands killed: {options.images} rows, none lost or "
                f"doubled; numbers differ by {apart:.1e} at most.",
                flush=True,
            )
            if len(table_of(often)) != options.images or apart > 1e-5:
                raise SystemExit(1)
            require(killed, options.kills)
        if options.rounds:
            rates = measured(photos, folder, options.rounds, options.part)
            one, two = (statistics.median(rates[workers]) for workers in (1, 2))
            print(
                f"Medians: {one:.2f} and {two:.2f} images per second, {two / one:.2f} times as fast."
            )
            if two / one < options.ratio:
                raise SystemExit(1)


if __name__ == "__main__":
    main()
