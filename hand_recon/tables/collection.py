"""The runs that a user means, sorted into studies."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hand_recon.tables.runs import FinishedRun, LeftOut, default_place, read_run, run_folders
from hand_recon.tables.studies import Compared, Study, group


@dataclass(frozen=True)
class Collection:
    """What was found."""

    places: tuple[str, ...]
    """Where was looked."""
    studies: tuple[Study, ...]
    """Those with most rows of Table 1 first."""
    left_out: tuple[LeftOut, ...]
    """Runs that are in no study, and why."""


def collect(runs: str | Iterable[str] | None, output: Path, compared: Compared) -> Collection:
    """Find, read and sort runs.

    Args:
        runs: A folder or pattern, or several; none for the newest sweep, or what else there is.
        output: Where runs are written, for that default.
        compared: How settings are read.

    Raises:
        FileNotFoundError: What `runs` names does not exist.
    """
    if runs is None:
        runs = str(default_place(output.absolute()))
    places = (runs,) if isinstance(runs, str) else tuple(str(place) for place in runs)
    read = [read_run(folder) for folder in run_folders(places)]
    studies, replaced = group([run for run in read if isinstance(run, FinishedRun)], compared)
    left_out = (*(run for run in read if isinstance(run, LeftOut)), *replaced)
    return Collection(places, studies, left_out)
