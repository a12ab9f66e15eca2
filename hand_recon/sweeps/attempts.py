"""Attempts at a run of a sweep: finished ones, one that can be continued, and the folder of the next."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hand_recon.command_line.words import quoted
from hand_recon.runs.resuming import last_whole
from hand_recon.runs.unfinished import MARK, is_in_use
from hand_recon.runs.unfinished_runs import training_settings
from hand_recon.tables.member_record import (
    ERROR_FILE,
    MEMBER_FILE,
    OUTPUT_FILE,
    State,
    read_member,
)
from hand_recon.tables.runs import METRICS_FILE, SETTINGS_FILE

logger = logging.getLogger(__name__)

CONTINUING: frozenset[str] = frozenset({"train"})
"""Verbs whose runs go on in a new folder, by `resume=`; others go on in their own folder, or begin anew."""

_OF_THE_SWEEP: frozenset[str] = frozenset({MEMBER_FILE, ERROR_FILE, OUTPUT_FILE, ".hydra"})
"""Entries of a run's folder that the sweep and Hydra write."""


@dataclass(frozen=True)
class Member:
    """One run of a sweep."""

    verb: str
    """A key of `VERBS`."""
    config_name: str
    """File of `conf`."""
    overrides: tuple[str, ...]
    """Overrides in Hydra's grammar."""
    folder: Path
    """Its folder; further attempts are in folders beside it."""
    settings: Any
    """Settings that the results depend on, as JSON holds them."""
    name: str
    """Name for people: its number in the sweep, and what it has apart from other runs."""


@dataclass(frozen=True)
class Attempt:
    """The next attempt at a run."""

    folder: Path
    """Its folder."""
    overrides: tuple[str, ...]
    """All overrides: those of the run, its folder, and what it continues."""


def attempts(folder: Path) -> Iterator[Path]:
    """Folders of the attempts so far: the run's own, then `<name>__2`, `<name>__3` and so on."""
    number, one = 1, folder
    while one.exists():
        yield one
        number += 1
        one = _numbered(folder, number)


def finished_attempt(member: Member) -> Path | None:
    """Folder of a finished attempt with the same settings; None if there is none."""
    return next((one for one in attempts(member.folder) if _is_finished(one, member)), None)


def attempt_in_use(member: Member) -> Path | None:
    """Folder of an attempt that a process of this machine goes on with; None if there is none."""
    return next((one for one in attempts(member.folder) if is_in_use(one)), None)


def next_attempt(member: Member) -> Attempt:
    """Folder and overrides with which a run goes on, or begins anew.

    A training that has a whole checkpoint of the same settings is continued from it, in a new folder.
    Commands that mark a folder as unfinished and go on there, such as `fit`, have it again if their settings
    are the same. All others begin anew, in a new folder.
    """
    before = list(attempts(member.folder))
    if before and _goes_on_in(before[-1], member):
        return _at(member, before[-1])
    empty = not before or not _has_run(before[-1], member.verb)
    number = len(before) + (not empty)
    folder = member.folder if number <= 1 else _numbered(member.folder, number)
    if _continues(member):
        for earlier in reversed(before):
            if _settings_of(earlier) == member.settings and _has_checkpoint(earlier):
                return _at(member, folder, f"resume={quoted(str(earlier))}")
    return _at(member, folder)


def _goes_on_in(folder: Path, member: Member) -> bool:
    """True if an attempt's folder is one that the same command goes on in."""
    unfinished = member.verb not in CONTINUING and (folder / MARK).exists()
    return unfinished and bool(_settings_of(folder) == member.settings)


def _continues(member: Member) -> bool:
    """True for a run that takes `resume=`; the repetition of a run (`from_run`) has no setting besides."""
    names = (override.lstrip("+").partition("=") for override in member.overrides)
    repeats = any(name == "from_run" and value not in ("", "null") for name, _, value in names)
    return member.verb in CONTINUING and not repeats


def _numbered(folder: Path, number: int) -> Path:
    return folder.with_name(f"{folder.name}__{number}")


def _at(member: Member, folder: Path, *more: str) -> Attempt:
    run = ("hydra.mode=RUN", f"hydra.run.dir={quoted(str(folder.absolute()))}")
    return Attempt(folder, (*member.overrides, *more, *run))


def _has_run(folder: Path, verb: str) -> bool:
    """True if an attempt has left something that the next one may not write again."""
    if verb in CONTINUING:
        return any((folder / name).exists() for name in (SETTINGS_FILE, METRICS_FILE, MARK))
    return any(one.name not in _OF_THE_SWEEP and one.suffix != ".log" for one in folder.iterdir())


def _is_finished(folder: Path, member: Member) -> bool:
    record = read_member(folder)
    complete = (folder / METRICS_FILE).is_file() and not (folder / MARK).exists()
    if record is not None and member.verb not in CONTINUING:
        complete = record.state == State.FINISHED
    if not complete:
        return False
    if _settings_of(folder) != member.settings:
        logger.warning("%s is finished, but with other settings: this is a new run.", folder)
        return False
    return True


def _settings_of(folder: Path) -> Any:  # noqa: ANN401  # any JSON
    """Settings that an attempt had; None if its folder does not say."""
    record = read_member(folder)
    if record is not None:
        return record.settings
    try:
        return training_settings(OmegaConf.create(OmegaConf.load(folder / SETTINGS_FILE)))  # type: ignore[arg-type]
    except (OSError, ValueError, yaml.YAMLError, OmegaConfBaseException):
        return None


def _has_checkpoint(folder: Path) -> bool:
    try:
        return last_whole(folder).is_file()
    except ValueError as error:
        logger.warning("%s", error)
        return False
