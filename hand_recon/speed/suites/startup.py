"""Start of the commands, in fresh processes: from the call to the end, or to the first step of a training."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import Final

from hand_recon.speed.measurement import Settings, spread
from hand_recon.speed.rows import LeftOut, Row

COMMANDS: Final = {
    "import hand_recon": ("-c", "import hand_recon"),
    "hand-recon --help": ("-m", "hand_recon", "--help"),
    "hand-recon fit --help": ("-m", "hand_recon", "fit", "--help"),
    "import torch": ("-c", "import torch"),
}
"""Commands and the words after `python`; torch alone is the floor of all that need it."""
RUNS: Final = 5

FIRST_STEP: Final = """
import os, sys
from hand_recon.command_line.hydra_verb import run_verb
from hand_recon.training.module import HandReconstruction

HandReconstruction.on_train_batch_end = lambda *_: os._exit(0)
run_verb("train", "", sys.argv[1:])
raise SystemExit("The training ended before its first step.")
"""
"""Program that begins a training and ends after its first optimizer step."""

WANTED_FIRST_STEP: Final = 60.0
"""Most seconds from the call to the first step of the default training without a cache, on two cores."""


def measure(settings: Settings) -> Iterator[Row | LeftOut]:
    """Time each command in turn, then the start of the default training."""
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(2 if settings.quick else RUNS):
        for name, words in COMMANDS.items():
            began = time.perf_counter()
            command = [sys.executable, *words]
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603  # our own words
            times[name].append(time.perf_counter() - began)
    for name, taken in times.items():
        yield Row(suite="startup", work=name, size="1 process", seconds=spread(taken))
    if settings.quick:
        yield LeftOut("startup", "train to the first step", "quick=true")
        return
    yield Row(
        suite="startup",
        work="train to the first step, nothing rendered",
        size="1 process and 2 that render",
        seconds=spread([seconds_to_first_step()]),
        wanted_seconds=WANTED_FIRST_STEP,
    )


def seconds_to_first_step(*words: str) -> float:
    """Begin a training with an empty cache; seconds until its first step is done.

    Args:
        words: Further settings of `hand-recon train`.
    """
    # What still renders ends with the training, and may be writing its last file meanwhile.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        places = [f"paths.output={folder}/runs", f"paths.cache={folder}/cache"]
        command = [sys.executable, "-c", FIRST_STEP, *places, *words]
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603  # our own words
        return time.perf_counter() - began
