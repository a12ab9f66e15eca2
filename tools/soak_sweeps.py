"""Run a sweep whose members fail and are killed, run it again, and check what became of each member.

python tools/soak_sweeps.py

Eight trainings of a small lifter, two at a time: four fail (a negative learning rate) and two are killed by
SIGKILL at their twelfth step. Run again, the finished ones are to be skipped, the killed ones to go on, and
to have the losses of their twins that were not killed, in every bit; the failed ones are to fail again. The
exit status is 1 if anything is otherwise.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from hand_recon.runs.logged_scalars import compare_logs  # noqa: E402
from tests.support.killed_training import LIFTER  # noqa: E402

SWEPT = ("seed=0,1", "optimizer.lr=0.001,-1.0", "+callbacks.kill.number=0,9")
"""Eight members; signal 0 does nothing."""

KILL_AT = 12
"""Step of the signal; training has 20."""

EXPECTED = {
    "first": ["finished", "killed", "failed", "failed"] * 2,
    "again": ["skipped", "finished", "failed", "failed"] * 2,
    "third": ["skipped", "skipped", "failed", "failed"] * 2,
}
"""State of each member after each run of the sweep."""


def run_sweep(folder: Path, step: int) -> int:
    """Run the sweep; its exit status.

    Args:
        folder: For its cache and its members.
        step: Step of the signal; -1 for none.
    """
    words = [
        *LIFTER, *SWEPT, f"+callbacks.kill.step={step}",
        "+callbacks.kill._target_=tests.support.killed_training.Kill", "hydra.launcher.n_jobs=2",
        f"hydra.sweep.dir={folder / 'sweep'}", "hydra.sweep.subdir=${hydra:job.num}",
        f"paths.cache={folder / 'cache'}", f"paths.output={folder}",
    ]  # fmt: skip
    command = [sys.executable, "-m", "hand_recon.train", "-m", *words]
    return subprocess.run(command, cwd=ROOT, check=False).returncode  # noqa: S603  # our own words


def members_of(sweep: Path) -> list[Path]:
    """Folder of the last attempt at each member."""
    found = []
    for number in range(8):
        attempts = sorted(sweep.glob(f"{number}__*"))
        found.append(attempts[-1] if attempts else sweep / str(number))
    return found


def states(sweep: Path, finished_before: set[Path]) -> list[str]:
    """State of each member; `skipped` for one that had finished before."""
    return [
        "skipped"
        if folder in finished_before
        else str(json.loads((folder / "member.json").read_text())["state"])
        for folder in members_of(sweep)
    ]


def soak(folder: Path) -> bool:
    """Run the sweep three times; true if all is as expected.

    Args:
        folder: Empty folder.
    """
    good, finished = True, set[Path]()
    rows = []
    for name, expected in EXPECTED.items():
        status = run_sweep(folder, KILL_AT if name == "first" else -1)
        found = states(folder / "sweep", finished)
        finished = {one for one in members_of(folder / "sweep") if (one / "metrics.json").exists()}
        good = good and found == expected and status == 1
        counts = ", ".join(f"{found.count(one)} {one}" for one in dict.fromkeys(found))
        rows.append(f"| {name} | {counts} | {status} | {found == expected} |")
    print("| run of the sweep | members | exit status | as expected |\n|---|---|---|---|")
    print("\n".join(rows))
    for twin, killed in ((0, 1), (4, 5)):
        last = members_of(folder / "sweep")
        compared = compare_logs(last[twin], last[killed])
        print(
            f"{last[killed].name}, killed and continued, beside {last[twin].name}: {compared.told()}"
        )
        good = good and compared.same
    return good


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; the exit status is 1 if anything is not as expected."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--folder", type=Path, help="new folder that is kept (default: a temporary one)"
    )
    chosen = parser.parse_args(words)
    os.environ["OMP_NUM_THREADS"] = "1"
    if chosen.folder is not None:
        chosen.folder.mkdir(parents=True)
        return 0 if soak(chosen.folder.absolute()) else 1
    with tempfile.TemporaryDirectory() as folder:
        return 0 if soak(Path(folder)) else 1


if __name__ == "__main__":
    raise SystemExit(main())
