"""Kill trainings again and again at random steps, continue them, and compare with one that was not killed.

python tools/soak_resume.py --kills 100 --seed 0

Each training is a lifter's of twenty steps on one thread. It is continued with resume=auto, and killed again,
by SIGKILL or SIGTERM, up to five times; after one kill in ten, its last checkpoint is cut short. There is
a row for each training: its kills, whether `metrics.csv` is the same text, and how many entries of its last
checkpoint differ in a bit. The exit status is 1 if anything differs.
"""

import argparse
import random
import signal
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.killed_training import (  # noqa: E402
    STEPS,
    Death,
    logged,
    other_entries,
    start,
    status,
)

KILLS_OF_A_TRAINING = 5
"""Most kills of one training before it is let to its end."""


@dataclass(frozen=True)
class Row:
    """A training that was killed and continued."""

    deaths: list[Death]
    """The kills."""
    survived: int
    """Kills after which the same command went on."""
    same_losses: bool
    """True if the logged scalars are the same text."""
    entries: list[str]
    """Entries of the last checkpoint that differ."""

    @property
    def exact(self) -> bool:
        """True if nothing differs."""
        return self.same_losses and not self.entries and self.survived == len(self.deaths)

    def __str__(self) -> str:
        kills = " ".join(f"{signal.Signals(one.number).name}@{one.step}" for one in self.deaths)
        losses = "same" if self.same_losses else "DIFFERENT"
        return f"| {kills} | {self.survived}/{len(self.deaths)} | {losses} | {len(self.entries)} |"


def soak(folder: Path, kills: int, seed: int) -> list[Row]:
    """Kill and continue trainings.

    Args:
        folder: Empty folder for them.
        kills: Kills of all trainings together.
        seed: Seed of steps, signals and numbers of kills.
    """
    draws = random.Random(seed)  # noqa: S311  # no cryptography
    whole = folder / "whole" / "train" / "0"
    if status(start(folder / "cache", whole)) != 0:
        raise RuntimeError(f"The training without a kill failed; see {whole}.")
    rows: list[Row] = []
    print("| killed by | survived | losses | entries that differ |\n|---|---|---|---|")
    while (left := kills - sum(len(row.deaths) for row in rows)) > 0:
        count = min(left, draws.randint(1, KILLS_OF_A_TRAINING))
        rows.append(_killed(folder, f"{len(rows)}", count, draws, whole))
        print(rows[-1], flush=True)
    return rows


def _killed(folder: Path, name: str, count: int, draws: random.Random, whole: Path) -> Row:
    """Kill one training some times, at ever later steps, and compare its end."""
    runs = folder / name / "train"
    steps = sorted(draws.sample(range(STEPS), count))
    deaths = [Death(step, draws.choice((signal.SIGKILL, signal.SIGTERM))) for step in steps]
    came: list[Death] = []
    survived, end = 0, runs / "end"
    for number, death in enumerate(deaths):
        run = runs / str(number)
        code = status(start(folder / "cache", run, "resume=auto", death=death))
        if code == 0:
            # SIGTERM at an epoch's last step is obeyed after the next one, in which this kill was to come.
            end = run
            break
        came.append(death)
        survived += code in {-signal.SIGKILL, 128 + signal.SIGTERM}
        if draws.random() < 0.1:
            _cut(run / "checkpoints" / "last.ckpt")
    if not end.exists() and status(start(folder / "cache", end, "resume=auto")) != 0:
        return Row(came, survived - 1, same_losses=False, entries=["no end"])
    return Row(came, survived, logged(end) == logged(whole), other_entries(end, whole))


def _cut(file: Path) -> None:
    """Leave the first half of a file, where there is one before it to fall back to."""
    if file.with_name("before_last.ckpt").is_file():
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; the exit status is 1 if a training did not end like the one without a kill."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=100, help="kills in all (default 100)")
    parser.add_argument("--seed", type=int, default=0, help="seed of steps and signals")
    chosen = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        rows = soak(Path(folder), chosen.kills, chosen.seed)
    tried = sum(len(row.deaths) for row in rows)
    survived = sum(row.survived for row in rows)
    exact = sum(row.exact for row in rows)
    print(
        f"{survived} of {tried} kills survived; {exact} of {len(rows)} trainings equal in every bit."
    )
    return 0 if exact == len(rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
