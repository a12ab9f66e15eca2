"""Runs as they lie in their folders: settings, scores, and the errors of every test hand."""

import csv
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from jaxtyping import Float, Int
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

SETTINGS_FILE: Final = "config.yaml"
"""A run's resolved configuration: the first file that a run writes."""
METRICS_FILE: Final = "metrics.json"
"""A run's scores: without it the run is not finished."""
PER_HAND_FILE: Final = "per_hand.csv"
"""One line per test hand: `index`, then its errors in millimetres."""


@dataclass(frozen=True)
class PerHand:
    """The errors of single test hands, sorted by index, each hand once."""

    index: Int[np.ndarray, " hand"]
    """Position of each hand in the test set."""
    errors: dict[str, Float[np.ndarray, " hand"]]
    """Errors by name, millimetres; NaN where a hand has no such error."""


@dataclass(frozen=True)
class FinishedRun:
    """One run that has scores."""

    folder: Path
    """Where it lies."""
    name: str
    """Of its experiment."""
    seed: int
    """What was drawn with."""
    settings: dict[str, str]
    """Every setting by its dotted name, as text."""
    facts: dict[str, Any]
    """What else its `metrics.json` says, such as `data` and `test_hands`."""
    scores: dict[str, float]
    """On the test hands; what is no finite number is left out."""
    mean_pose: dict[str, float]
    """Of the constant hand on the same test hands; empty where there is no 3D."""
    per_hand: PerHand | None
    """Absent where the run wrote none."""


@dataclass(frozen=True)
class LeftOut:
    """A folder that is in no table, and why."""

    folder: Path
    """Where it lies."""
    reason: str
    """In words."""


def default_place(output: Path) -> Path:
    """The newest sweep that holds a finished run; without one, everything below the output folder.

    Newest by name: sweeps are named by their time.
    """
    sweeps = sorted((folder for folder in output.glob("sweeps/*") if folder.is_dir()), reverse=True)
    for sweep in sweeps:
        if any((folder / METRICS_FILE).is_file() for folder in run_folders([sweep])):
            return sweep
    return output


def run_folders(places: Iterable[str | Path]) -> list[Path]:
    """The folders of runs below some places, each once, sorted.

    A run's folder holds settings or metrics; nothing below it is another run.

    Args:
        places: Folders, or patterns with `*`, `?` and `**`.

    Raises:
        FileNotFoundError: A place does not exist, or a pattern matches nothing.
    """
    found: set[Path] = set()
    for place in places:
        for start in _matches(Path(place).expanduser()):
            for path, below, files in os.walk(start):
                if SETTINGS_FILE in files or METRICS_FILE in files:
                    found.add(Path(path).absolute())
                    below.clear()
                # Hydra keeps a config.yaml of its own in `.hydra`.
                below[:] = [name for name in below if not name.startswith(".")]
    return sorted(found)


def read_run(folder: Path) -> FinishedRun | LeftOut:
    """Read what a run left behind, or say why it can be in no table."""
    if not (folder / METRICS_FILE).is_file():
        return LeftOut(folder, f"unfinished: it has no {METRICS_FILE}")
    try:
        metrics = json.loads((folder / METRICS_FILE).read_text(encoding="utf-8"))
        config = _read_settings(folder / SETTINGS_FILE)
        per_hand = _read_per_hand(folder / PER_HAND_FILE)
    except (OSError, ValueError, yaml.YAMLError, OmegaConfBaseException) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        return LeftOut(folder, f"unreadable: {reason[0]}")
    if not isinstance(metrics, dict) or not _numbers(metrics.get("test")):
        return LeftOut(folder, f"its {METRICS_FILE} has no test scores")
    known = {**metrics, **config}
    if "name" not in known or not isinstance(known.get("seed"), int):
        return LeftOut(
            folder,
            f"without a {SETTINGS_FILE} its seed and settings are unknown: the evaluation of a checkpoint "
            "repeats a run that is counted already",
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


def flattened(settings: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Nested settings by dotted names, values as text.

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


def _matches(place: Path) -> list[Path]:
    if any(character in str(place) for character in "*?["):
        # Path.glob takes relative patterns only.
        anchor = Path(place.anchor or ".")
        matches = sorted(path for path in anchor.glob(str(place.relative_to(place.anchor))))
    else:
        matches = [place]
    if not matches or not all(path.exists() for path in matches):
        raise FileNotFoundError(
            f"No run at {place}. Give runs=<folder of a sweep>, or a pattern in quotes such as "
            "'runs=outputs/sweeps/*/*row4*'."
        )
    return matches


def _read_settings(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
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
    index, first = np.unique([int(line["index"]) for line in lines], return_index=True)
    errors = {
        name: np.array([float(line[name] or "nan") for line in lines])[first]
        for name in lines[0]
        if name not in (None, "index")
    }
    return PerHand(index, errors)


def _numbers(scores: object) -> dict[str, float]:
    """What of a mapping is a finite number."""
    if not isinstance(scores, dict):
        return {}
    return {
        str(name): float(value)
        for name, value in scores.items()
        if isinstance(value, int | float) and math.isfinite(value)
    }
