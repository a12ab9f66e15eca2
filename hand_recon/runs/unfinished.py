"""Marks a folder whose results are not complete, so that the same command goes on in it after a kill."""

import json
import logging
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from hand_recon import __version__
from hand_recon.data.whole_files import replaced_when_whole
from hand_recon.runs.configuration import plain

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

logger = logging.getLogger(__name__)

MARK: Final = "unfinished.json"
"""File of an unfinished folder: the settings and inputs of the command that writes there."""

CONTINUED: Final = "continued.json"
"""The mark of a training whose checkpoints another folder has taken over."""

_NO_RESULT: Final = frozenset({"output", "threads", "strict", "json", "paths", "landmarks", "name"})
"""Settings that the numbers of the results do not depend on, or whose files are compared instead."""


def make_folder(folder: Path) -> None:
    """Make a folder for results, with those above it, unless it is there.

    Raises:
        FileExistsError: It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileExistsError(
            f"The folder {folder} cannot be made ({error.strerror}). Name another one with output=…."
        ) from error


def mark_unfinished(folder: Path, settings: dict[str, Any]) -> None:
    """Mark a new folder of results and keep other commands out of it; `finish` ends both.

    Args:
        folder: A folder that `claim_folder` made.
        settings: What the results depend on, as JSON holds it.

    Raises:
        FileExistsError: Another command is writing there.
    """
    folder = folder.absolute()
    lock(folder)
    _write(folder / MARK, settings)


def free_folder(path: str | Path, products: Sequence[str]) -> Path:
    """Check that a folder has none of the files of a command's results.

    Args:
        path: The folder, which need not exist.
        products: Files and folders that the command writes.

    Raises:
        FileExistsError: It has one.
    """
    folder = Path(path).expanduser().absolute()
    taken = [name for name in products if (folder / name).exists()]
    if taken:
        raise FileExistsError(
            f"{folder} already holds {', '.join(taken)}, and nothing is overwritten. Name another folder "
            "with output=<folder>."
        )
    return folder


def claim_or_resume(path: str | Path, products: Sequence[str], settings: dict[str, Any]) -> bool:
    """Make a folder for results, or recognize one that the same command left unfinished.

    Args:
        path: The folder.
        products: Files and folders that the command writes.
        settings: What the results depend on, as JSON holds it: options, and inputs with their sizes.

    Returns:
        True if the folder is one to go on in.

    Raises:
        FileExistsError: The folder holds complete results, or unfinished ones of other settings.
    """
    folder = Path(path).expanduser().absolute()
    make_folder(folder)
    lock(folder)
    taken = [name for name in products if (folder / name).exists()]
    mark = folder / MARK
    if not taken and not mark.exists():
        _write(mark, settings)
        return False
    if not mark.exists():
        raise FileExistsError(
            f"{folder} already holds {', '.join(taken)}, and nothing is overwritten. Name another folder "
            "with output=…."
        )
    before = _read(mark)
    changed = sorted(
        key for key in {*before, *settings} if before.get(key) != _as_json(settings.get(key))
    )
    if changed:
        raise FileExistsError(
            f"{folder} holds unfinished results of a command with other {', '.join(changed)}, and "
            f"nothing is overwritten. {_cure(before, settings)}"
        )
    logger.info("%s holds unfinished results of this command, which goes on there.", folder)
    return True


def _cure(before: dict[str, Any], settings: dict[str, Any]) -> str:
    """Sentences on what to do about results that cannot be completed by this command."""
    if before.get("version") != settings.get("version"):
        return (
            f"They are of version {before.get('version', 'unknown')} of hand_recon, and this is version "
            f"{settings.get('version')}, whose options and numbers may be others: name another folder with "
            "output=…, or complete them with that version."
        )
    return (
        "Files are other ones when they were changed; options that were not given are other ones where "
        "another state of hand_recon has other defaults. Name another folder with output=…, or repeat that "
        "command to complete the results."
    )


def results_folder(config: DictConfig) -> Path:
    """Folder of the results of a command: `output`, or Hydra's of a sweep, or a new one named by the time.

    Args:
        config: Configuration with `output`, `paths.output` and `name`.
    """
    if config.output:
        return Path(config.output).expanduser().absolute()
    hydra = HydraConfig.get()
    if hydra.mode == RunMode.MULTIRUN or hydra.run.dir != ".":
        return Path(hydra.runtime.output_dir).absolute()
    now = time.strftime("%Y-%m-%d_%H-%M-%S")
    return (Path(config.paths.output) / config.name / now).absolute()


def finish(folder: str | Path) -> None:
    """Remove the mark: the results are complete."""
    folder = Path(folder).expanduser().absolute()
    (folder / MARK).unlink()
    _unlock(folder)


_locks: dict[Path, int] = {}


def lock(folder: Path) -> None:
    """Keep other commands out of a folder until this process ends, where the system has such locks.

    Args:
        folder: Of results.

    Raises:
        FileExistsError: Another command is writing there.
    """
    folder = folder.absolute()
    if fcntl is None:
        return
    _unlock(folder)
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise FileExistsError(
            f"Another command is writing into {folder}. Wait until it has ended, or name another folder with "
            "output=…."
        ) from error
    except OSError:
        # A file system without locks.
        os.close(handle)
        return
    _locks[folder] = handle


def is_in_use(folder: Path) -> bool:
    """True if another process writes into a folder of results; unknown, and so false, without locks.

    Args:
        folder: Of results, which this process does not write into.
    """
    try:
        lock(folder)
    except FileExistsError:
        return True
    _unlock(folder.absolute())
    return False


def hand_over(folder: Path) -> None:
    """Turn the mark of an unfinished folder, which another one now continues, into that of a continued one.

    Args:
        folder: Of results; it may be one that cannot be written to.
    """
    folder = folder.absolute()
    try:
        (folder / MARK).rename(folder / CONTINUED)
    except OSError:
        logger.debug("%s has no mark that can be changed.", folder)
    _unlock(folder)


def _unlock(folder: Path) -> None:
    if (handle := _locks.pop(folder, None)) is not None:
        os.close(handle)


def _let_go() -> None:
    """Close the locks in a process that was forked, which would keep them after a kill of this one."""
    while _locks:
        os.close(_locks.popitem()[1])


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


def settings_of(config: DictConfig, files: Sequence[str]) -> dict[str, Any]:
    """Settings for `claim_or_resume`: all but the inputs that the results of a command depend on.

    Args:
        config: Configuration of the command.
        files: Settings that may name a file or a folder.
    """
    return {
        "options": {key: value for key, value in plain(config).items() if key not in _NO_RESULT},
        "files": states_of_files(config, files),
        "version": __version__,
    }


def states_of_files(config: DictConfig, keys: Sequence[str]) -> dict[str, Any]:
    """States of the files that settings name, by setting; settings that name no file are left out.

    Args:
        config: Configuration of the command.
        keys: Settings that may name a file or a folder.
    """
    found = {}
    for key in keys:
        value = OmegaConf.select(config, key, throw_on_missing=False)
        path = Path(str(value)).expanduser()
        if value is not None and path.exists():
            found[key] = file_state(path)
    return found


def file_state(path: Path) -> list[Any]:
    """Name, size and time of change of an input file, which tell whether it is the same as before."""
    try:
        known = path.stat()
    except OSError:
        # Such as a link to nowhere; reading it says what is wrong.
        return [str(path.absolute()), None, None]
    return [str(path.absolute()), known.st_size, known.st_mtime_ns]


def _as_json(value: object) -> Any:  # noqa: ANN401  # any JSON
    return json.loads(json.dumps(value))


def _read(mark: Path) -> dict[str, Any]:
    try:
        content = json.loads(mark.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise FileExistsError(
            f"{mark} is damaged, so that it is not known what {mark.parent} holds. Name another folder with "
            "output=…, or delete this one."
        )
    return content


def _write(mark: Path, settings: dict[str, Any]) -> None:
    with replaced_when_whole(mark) as unfinished:
        unfinished.write_text(json.dumps(settings, indent=1), encoding="utf-8")
