"""Start of the commands, in fresh processes: from the shell's call to the end."""

import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Final

from hand_recon.speed.measurement import Settings, spread
from hand_recon.speed.rows import Row

COMMANDS: Final = {
    "import hand_recon": ("-c", "import hand_recon"),
    "hand-recon --help": ("-m", "hand_recon", "--help"),
    "hand-recon fit --help": ("-m", "hand_recon", "fit", "--help"),
    "import torch": ("-c", "import torch"),
}
"""Commands and the words after `python`; torch alone is the floor of all that need it."""
RUNS: Final = 5


def measure(settings: Settings) -> Iterator[Row]:
    """Time each command in turn."""
    times: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(2 if settings.quick else RUNS):
        for name, words in COMMANDS.items():
            began = time.perf_counter()
            command = [sys.executable, *words]
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603  # our own words
            times[name].append(time.perf_counter() - began)
    for name, taken in times.items():
        yield Row(suite="startup", work=name, size="1 process", seconds=spread(taken))
