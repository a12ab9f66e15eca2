"""Marks a folder whose results are not complete, so that the same command goes on in it after a kill."""

import json
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

logger = logging.getLogger(__name__)

MARK: Final = "unfinished.json"
"""File of an unfinished folder: the settings and inputs of the command that writes there."""


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
    taken = [name for name in products if (folder / name).exists()]
    mark = folder / MARK
    if not taken and not mark.exists():
        folder.mkdir(parents=True, exist_ok=True)
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
            f"{folder} holds unfinished results of a command with other {', '.join(changed)}, and nothing is "
            "overwritten. Repeat that command to complete them, or name another folder with output=…."
        )
    logger.info("%s holds unfinished results of this command, which goes on there.", folder)
    return True


def finish(folder: str | Path) -> None:
    """Remove the mark: the results are complete."""
    (Path(folder).expanduser() / MARK).unlink()


def file_state(path: Path) -> list[Any]:
    """Name, size and time of change of an input file, which tell whether it is the same as before."""
    known = path.stat()
    return [str(path.absolute()), known.st_size, known.st_mtime_ns]


def _as_json(value: object) -> Any:  # noqa: ANN401  # any JSON
    return json.loads(json.dumps(value))


def _read(mark: Path) -> dict[str, Any]:
    try:
        content = json.loads(mark.read_text(encoding="utf-8"))
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise FileExistsError(
            f"{mark} is damaged, so that it is not known what {mark.parent} holds. Name another folder with "
            "output=…, or delete this one."
        )
    return content


def _write(mark: Path, settings: dict[str, Any]) -> None:
    # Complete or absent, also after a kill.
    partial = mark.with_name(f"{mark.name}.part")
    partial.write_text(json.dumps(settings, indent=1, ensure_ascii=False), encoding="utf-8")
    os.replace(partial, mark)
