"""Reader of finished runs: settings, scores, and the errors of every test hand."""

import csv
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float, Int
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hand_recon.reading.naming import naming
from hand_recon.reading.text import parse_json, parse_yaml, read_text
from hand_recon.tables.member_record import MEMBER_FILE, State, read_member

SETTINGS_FILE: Final = "config.yaml"
"""File of a run's resolved configuration, the first that a run writes."""
METRICS_FILE: Final = "metrics.json"
"""File of a run's scores; a run without it is not finished."""
PER_HAND_FILE: Final = "per_hand.csv"
"""File with one line per test hand: `index`, then its errors in millimetres."""


@dataclass(frozen=True)
class PerHand:
    """Errors of single test hands, sorted by index, each hand once."""

    index: Int[np.ndarray, " hand"]
    """Position of each hand in the test set."""
    errors: dict[str, Float[np.ndarray, " hand"]]
    """Errors by name, millimetres; NaN where a hand has no such error."""


@dataclass(frozen=True)
class FinishedRun:
    """A run that has scores."""

    folder: Path
    """Folder of the run."""
    name: str
    """Name of its experiment."""
    seed: int
    """Random seed."""
    settings: dict[str, str]
    """Settings by dotted name, as text."""
    facts: dict[str, Any]
    """Other entries of its `metrics.json`, such as `data` and `test_hands`."""
    scores: dict[str, float]
    """Scores on the test hands; those that are not finite are left out."""
    mean_pose: dict[str, float]
    """Scores of the mean pose on the same test hands; empty without 3D ground truth."""
    per_hand: PerHand | None
    """Errors of single hands; absent where the run wrote none."""


@dataclass(frozen=True)
class LeftOut:
    """A run that is in no table, with the reason."""

    folder: Path
    """Folder of the run."""
    reason: str
    """Reason, in words."""


def default_folder(output: Path) -> Path:
    """Newest sweep that holds a finished run; without one, the output folder.

    Sweeps are named by their time and sorted by name.
    """
    sweeps = sorted((folder for folder in output.glob("sweeps/*") if folder.is_dir()), reverse=True)
    for sweep in sweeps:
        if any((folder / METRICS_FILE).is_file() for folder in run_folders([sweep])):
            return sweep
    return output


def run_folders(sources: Iterable[str | Path]) -> list[Path]:
    """Folders of runs below some folders, each once, sorted.

    A run's folder holds settings, metrics or the record of a run of a sweep; folders inside it are not
    searched.

    Args:
        sources: Folders, or patterns with `*`, `?` and `**`.

    Raises:
        FileNotFoundError: A folder does not exist, or a pattern matches nothing.
    """
    found: set[Path] = set()
    for source in sources:
        for start in _matches(Path(source).expanduser()):
            for path, below, files in os.walk(start):
                if {SETTINGS_FILE, METRICS_FILE, MEMBER_FILE} & set(files):
                    found.add(Path(path).absolute())
                    below.clear()
                # Hydra keeps a config.yaml of its own in `.hydra`.
                below[:] = [name for name in below if not name.startswith(".")]
    return sorted(found)


def read_run(folder: Path) -> FinishedRun | LeftOut:
    """Read a run's files; a run that cannot be in a table is returned with the reason."""
    if not (folder / METRICS_FILE).is_file():
        return LeftOut(folder, _unfinished(folder))
    try:
        metrics = parse_json(read_text(folder / METRICS_FILE), METRICS_FILE)
        with naming(SETTINGS_FILE, "the settings of a run"):
            config = _read_settings(folder / SETTINGS_FILE)
        with naming(PER_HAND_FILE, "errors of single hands"):
            per_hand = _read_per_hand(folder / PER_HAND_FILE)
    except (OSError, ValueError, TypeError, OmegaConfBaseException) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        return LeftOut(folder, f"unreadable: {reason[0]}")
    if not isinstance(metrics, dict) or not _numbers(metrics.get("test")):
        return LeftOut(folder, f"its {METRICS_FILE} has no test scores")
    if "_target_" in (config.get("prior") or {}):
        return LeftOut(folder, "its prior has the settings of hand_recon 0.1: use that version")
    known = {**metrics, **config}
    if "name" not in known or not isinstance(known.get("seed"), int):
        return LeftOut(
            folder,
            f"without a {SETTINGS_FILE} its seed and settings are unknown; it may be the evaluation of a "
            "checkpoint whose run is counted already",
        )
    return FinishedRun(
        folder=folder,
        name=str(known["name"]),
        seed=known["seed"],
        settings=flattened(config),
        facts={key: value for key, value in metrics.items() if not isinstance(value, dict)},
        scores=_numbers(metrics["test"]),
        mean_pose=_numbers(metrics.get("mean_pose")),
        per_hand=per_hand,
    )


def _unfinished(folder: Path) -> str:
    """Reason of a run without metrics, as the sweep that started it has noted it."""
    record = read_member(folder)
    if record is None or record.state == State.FINISHED:
        return f"unfinished: it has no {METRICS_FILE}"
    following = _following(folder)
    again = f"; run again in {following.name}" if following.exists() else ""
    return f"{record.told}{again}"


def _following(folder: Path) -> Path:
    """Folder of the next attempt at a run of a sweep: `0__2` after `0`, `0__3` after `0__2`."""
    name, mark, number = folder.name.rpartition("__")
    if mark and number.isdecimal() and folder.with_name(name).is_dir():
        return folder.with_name(f"{name}__{int(number) + 1}")
    return folder.with_name(f"{folder.name}__2")


def flattened(settings: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Flatten nested settings to dotted names, values as text.

    >>> flattened({"prior": {"shape": 10.0, "rules": ["a"]}, "seed": 1})
    {'prior.shape': '10.0', 'prior.rules': "['a']", 'seed': '1'}
    """
    flat: dict[str, str] = {}
    for key, value in settings.items():
        name = f"{above}.{key}" if above else str(key)
        if isinstance(value, Mapping):
            flat |= flattened(value, name)
        else:
            flat[name] = str(value)
    return flat


def _matches(source: Path) -> list[Path]:
    if any(character in str(source) for character in "*?["):
        # Path.glob takes relative patterns only.
        anchor = Path(source.anchor or ".")
        matches = sorted(path for path in anchor.glob(str(source.relative_to(source.anchor))))
    else:
        matches = [source]
    if not matches or not all(path.exists() for path in matches):
        raise FileNotFoundError(
            f"No run at {source}. Give runs=<folder of a sweep>, or a pattern in quotes such as "
            "'runs=outputs/sweeps/*/*row4*'."
        )
    return matches


def _read_settings(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    # OmegaConf's own reader is for trusted files.
    parse_yaml(read_text(path), path.name)
    settings = OmegaConf.to_container(OmegaConf.load(path), resolve=True)
    if not isinstance(settings, dict):
        raise ValueError(f"{path.name} holds no mapping")
    return {str(key): value for key, value in settings.items()}


def _read_per_hand(path: Path) -> PerHand | None:
    if not path.is_file():
        return None
    with path.open(newline="", encoding="utf-8") as stream:
        lines = list(csv.DictReader(stream))
    if not lines or "index" not in lines[0]:
        raise ValueError(f"{path.name} has no column `index`, or no hands")
    names = [name for name in lines[0] if name not in (None, "index")]
    if any(None in line or None in line.values() for line in lines):
        raise ValueError("a line has more or fewer cells than the first one")
    rows = np.array([[float(line[name] or "nan") for name in names] for line in lines])
    numbers = [int(line["index"]) for line in lines]
    if np.isinf(rows).any() or not all(0 <= number < 2**53 for number in numbers):
        raise ValueError("an error is infinite, or an index is no position in a test set")
    index, first = np.unique(numbers, return_index=True)
    errors = {name: rows[first, column] for column, name in enumerate(names)}
    return PerHand(index, errors)


def _numbers(scores: object) -> dict[str, float]:
    """Entries of a mapping that are finite numbers."""
    if not isinstance(scores, dict):
        return {}
    return {
        str(name): float(value)
        for name, value in scores.items()
        if isinstance(value, int | float) and math.isfinite(value)
    }
