"""Train on one, two and three processes, compare every score; kill and continue a training on two.

python tools/soak_processes.py --kills 5

A lifter is trained for four epochs, with twelve hands in each step, shared by the processes; there is a table
of every score with its difference to one process. Then trainings on two
processes are killed at random steps, by SIGKILL or SIGTERM to one of the two, and continued. The exit status
is 1 if a score differs by more than rounding does, or a continued training in a bit.
"""

import argparse
import random
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.killed_training import STEPS, Death, logged, other_entries, status  # noqa: E402
from tests.support.trained_together import (  # noqa: E402
    UNEVEN,
    WITH_GRADIENT,
    gradient_difference,
    scores,
    start_together,
)

HANDS = 12
"""Hands of a step of all processes together."""

ROUNDING = 5e-4
"""Largest relative difference of a score after training, of sums in another order."""

GRADIENT_ROUNDING = 1e-5
"""Largest relative difference of a gradient."""

LIFTER = (*UNEVEN, "trainer.max_epochs=4")


def trained(folder: Path, name: str, count: int, *overrides: str) -> Path:
    """Train on some processes; the run's folder.

    Raises:
        RuntimeError: One of them failed.
    """
    run = folder / name / "train" / str(count)
    words = (f"data.batch_size={HANDS // count}", WITH_GRADIENT, *overrides)
    codes = [status(one) for one in start_together(folder / "cache", run, count, *words)]
    if any(codes):
        raise RuntimeError(f"Exit statuses of {count} processes: {codes}; see {run.parent}.")
    return run


def compare(folder: Path) -> bool:
    """Print the scores of a lifter on one, two and three processes; True if they are the same."""
    runs = {count: trained(folder, "lifter", count, *LIFTER) for count in (1, 2, 3)}
    of = {count: scores(run) for count, run in runs.items()}
    print("| score | 1 process | 2: difference | 3: difference |\n|---|---|---|---|")
    largest = 0.0
    for name, value in of[1].items():
        apart = [abs(of[count][name] - value) for count in (2, 3)]
        largest = max(largest, *(one / max(abs(value), 1.0) for one in apart))
        print(f"| {name} | {value:.6g} | {apart[0]:.1e} | {apart[1]:.1e} |")
    gradients = [gradient_difference(runs[1], runs[count]) for count in (2, 3)]
    print(f"| first gradient, relative | | {gradients[0]:.1e} | {gradients[1]:.1e} |", flush=True)
    return largest < ROUNDING and max(gradients) < GRADIENT_ROUNDING


def killed(folder: Path, kills: int, seed: int) -> bool:
    """Kill trainings on two processes and continue them; True if all end in the same bits."""
    draws = random.Random(seed)  # noqa: S311  # no cryptography
    size = ("data.batch_size=8", "wait_minutes=2")
    runs = folder / "killed"
    whole = runs / "whole" / "train" / "0"
    codes = [status(one) for one in start_together(folder / "cache", whole, 2, *size)]
    if any(codes):
        raise RuntimeError(f"Exit statuses: {codes}; see {whole.parent}.")
    exact = True
    print("| killed | exit statuses | entries that differ |\n|---|---|---|")
    for number in range(kills):
        death = Death(draws.randrange(1, STEPS), draws.choice((signal.SIGKILL, signal.SIGTERM)))
        dying = draws.randrange(2)
        folders = [runs / str(number) / "train" / name for name in ("killed", "end")]
        words = (*size, "resume=auto")
        first = start_together(folder / "cache", folders[0], 2, *words, death=death, dying=dying)
        codes = [status(one) for one in first]
        again = [status(one) for one in start_together(folder / "cache", folders[1], 2, *words)]
        apart = ["no end"] if any(again) else other_entries(folders[1], whole)
        same = not apart and logged(folders[1]) == logged(whole)
        exact = exact and same and all(codes)
        name = signal.Signals(death.number).name
        print(
            f"| {name}@{death.step} of process {dying} | {codes}, {again} | {len(apart)} |",
            flush=True,
        )
    return exact


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; the exit status is 1 if processes or a kill changed a result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--kills", type=int, default=5, help="trainings that are killed (default 5)"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of steps, signals and processes")
    chosen = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        same = compare(Path(folder))
        exact = killed(Path(folder), chosen.kills, chosen.seed)
    print(
        f"Scores {'equal' if same else 'DIFFER'}; continued trainings {'equal' if exact else 'DIFFER'}."
    )
    return 0 if same and exact else 1


if __name__ == "__main__":
    raise SystemExit(main())
