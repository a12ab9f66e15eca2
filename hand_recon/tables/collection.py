"""Collection of runs from folders, grouped into studies."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from hand_recon.tables.runs import FinishedRun, LeftOut, default_folder, read_run, run_folders
from hand_recon.tables.studies import Compared, Study, group


@dataclass(frozen=True)
class Collection:
    """Runs that were found."""

    sources: tuple[str, ...]
    """Folders and patterns that were searched."""
    studies: tuple[Study, ...]
    """Studies, those with most rows of Table 1 first."""
    left_out: tuple[LeftOut, ...]
    """Runs that are in no study, with the reason."""


def collect(runs: str | Iterable[str] | None, output: Path, compared: Compared) -> Collection:
    """Find runs, read them and group them into studies.

    Args:
        runs: Folder or pattern, or several; none for the newest sweep, or all runs where there is no sweep.
        output: Folder of all runs, for that default.
        compared: Meaning of the settings for the comparison.

    Raises:
        FileNotFoundError: A folder in `runs` does not exist, or a pattern matches nothing.
    """
    if runs is None:
        runs = str(default_folder(output.absolute()))
    sources = (runs,) if isinstance(runs, str) else tuple(str(source) for source in runs)
    read = [read_run(folder) for folder in run_folders(sources)]
    studies, replaced = group([run for run in read if isinstance(run, FinishedRun)], compared)
    left_out = (*(run for run in read if isinstance(run, LeftOut)), *replaced)
    return Collection(sources, studies, left_out)
