"""Continues an interrupted run in a new folder, from exactly its last checkpoint (decisions 21 and 88)."""

import csv
import io
import logging
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig

from hand_recon.data.sample_order import PROCESSES
from hand_recon.runs.checkpoint_writer import (
    BEFORE_LAST,
    LAST,
    METRICS_KEY,
    POSITION_KEY,
    damage,
    write_checkpoint,
)
from hand_recon.runs.checkpoints import VERSION_KEY, read_checkpoint
from hand_recon.runs.configuration import plain, refuse_outdated
from hand_recon.runs.process_settings import expected_processes
from hand_recon.runs.unfinished import hand_over, lock
from hand_recon.runs.unfinished_runs import newest_unfinished

logger = logging.getLogger(__name__)

MUST_MATCH: Final = (
    "seed", "crop_size", "data", "hand", "model", "prior", "data_term", "supervision",
    "optimizer", "trainer.precision",
)  # fmt: skip
"""Settings that a continued run shares with the run that it continues."""

OF_THE_MACHINE: Final = frozenset(
    {"cache_dir", "root", "eval_root", "workers", "render_workers", "keep", "sizes", "weights"}
)
"""Settings that may differ: paths, numbers of processes, the place of the samples, lists of fixed length."""

AUTO: Final = "auto"
"""Value of `resume` for the newest unfinished run of the same configuration."""


@dataclass(frozen=True)
class Earlier:
    """The run that is continued."""

    file: Path
    """Its last checkpoint that is whole."""
    content: dict[str, Any]
    """Its contents."""

    @property
    def folder(self) -> Path | None:
        """The run's folder; none for a checkpoint that lies elsewhere."""
        return _run_of(self.file)

    @property
    def batches(self) -> int:
        """Training batches that it made."""
        loops = self.content["loops"]["fit_loop"]
        return int(loops["epoch_loop.batch_progress"]["total"]["ready"])


def earlier_run(config: DictConfig) -> Earlier | None:
    """Find the run to continue and check that its settings are the same; None for a new run.

    Args:
        config: Its `resume` is a checkpoint, a run's folder, `auto` or none; `auto` becomes the folder.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        FileExistsError: The run is still going on.
        ValueError: It was trained with other settings, or its checkpoints are damaged.
    """
    if config.resume == AUTO:
        found = newest_unfinished(config)
        config.resume = None if found is None else str(found)
    if config.resume is None:
        return None
    path = Path(config.resume).expanduser()
    run = path if path.is_dir() else _run_of(path)
    if run is not None and run.is_dir():
        lock(run)
    path = last_whole(path)
    checkpoint, saved = read_checkpoint(path)
    refuse_outdated(saved, str(path), checkpoint.get(VERSION_KEY))
    before, now = dict(_settings(plain(saved))), dict(_settings(plain(config)))
    changed = sorted(key for key in before | now if before.get(key) != now.get(key))
    if changed:
        described = ", ".join(_difference(key, before, now) for key in changed)
        raise ValueError(
            f"{path} was trained with other settings: {described}. A run is continued with the settings that "
            "it had (config.yaml in its folder lists them)."
        )
    _check_processes(path, checkpoint, expected_processes(config.trainer))
    if "optimizer_states" not in checkpoint:
        raise ValueError(
            f"{path} has weights alone, without the state of the optimizer. Continue from {LAST} beside it, "
            "or from the run's folder."
        )
    logger.info("Continuing %s from step %d.", path, checkpoint["global_step"])
    return Earlier(path, checkpoint)


def _check_processes(path: Path, checkpoint: dict[str, Any], now: int) -> None:
    """Check that as many processes share an epoch as before.

    Raises:
        ValueError: The number is another.
    """
    before = int(checkpoint.get(POSITION_KEY, {}).get(PROCESSES, 1))
    if before != now:
        raise ValueError(
            f"{path} was trained by {before} processes, and now there are {now}: the batches of its epoch "
            f"would be others. Continue with {before} (trainer.devices times trainer.num_nodes)."
        )


def last_whole(path: Path) -> Path:
    """The last checkpoint that is whole: the file itself, or a run's last one or the one before.

    Raises:
        ValueError: All of them are damaged.
    """
    last = path / "checkpoints" / LAST if path.is_dir() else path
    candidates = [last, last.with_name(BEFORE_LAST)] if last.name == LAST else [last]
    there = [file for file in candidates if file.is_file()]
    damaged: dict[Path, str] = {}
    for file in there:
        reason = damage(file)
        if reason is None:
            for other, found in damaged.items():
                logger.warning(
                    "%s is damaged (%s); the one before, %s, is used.", other, found, file.name
                )
            return file
        damaged[file] = reason
    if damaged:
        described = "; ".join(f"{file}: {reason}" for file, reason in damaged.items())
        raise ValueError(
            f"The checkpoint is damaged, and there is no other ({described}). Continue from an older copy, "
            "or train again without resume."
        )
    return last


def adopt(earlier: Earlier, folder: Path) -> Path:
    """Copy a run's checkpoints into the folder of the one that continues it.

    So a run that is killed at once, or that has nothing left to do, is as complete as the one before.

    Args:
        earlier: The run that is continued.
        folder: The new run's.

    Returns:
        The new run's last checkpoint.
    """
    checkpoints = Path(os.path.realpath(folder / "checkpoints"))
    checkpoints.mkdir(parents=True, exist_ok=True)
    best = _copy_best(earlier.file.with_name("best.ckpt"), checkpoints)
    callbacks = dict(earlier.content["callbacks"])
    for name, state in list(callbacks.items()):
        if name.startswith("ModelCheckpoint"):
            # Without its state, the next validation is the best so far.
            callbacks.pop(name)
            if best is not None and state["best_model_score"] is not None:
                callbacks[name] = _moved(state, best)
    write_checkpoint(earlier.content | {"callbacks": callbacks}, checkpoints / LAST)
    if earlier.folder is not None:
        hand_over(earlier.folder)
    return checkpoints / LAST


def _run_of(file: Path) -> Path | None:
    return file.parent.parent if file.parent.name == "checkpoints" else None


def _copy_best(file: Path, checkpoints: Path) -> Path | None:
    """Copy the best checkpoint; None where there is no whole one."""
    if not file.is_file():
        return None
    if (reason := damage(file)) is not None:
        logger.warning(
            "%s is damaged (%s): the best checkpoint will be one from now on.", file, reason
        )
        return None
    return Path(shutil.copy2(file, checkpoints / file.name))


def _moved(state: dict[str, Any], best: Path) -> dict[str, Any]:
    """State of Lightning's ModelCheckpoint, with its one best checkpoint in another folder."""
    score = state["best_model_score"]
    return state | {
        "best_model_path": str(best),
        "kth_best_model_path": str(best),
        "best_k_models": {str(best): score},
        "kth_value": score,
        "dirpath": str(best.parent),
        "last_model_path": "",
    }


def repeat_metrics(earlier: Earlier, loggers: Iterable[Logger]) -> None:
    """Log the scalars of the run that is continued, up to its checkpoint, so that each step is there once.

    Args:
        earlier: The run that is continued.
        loggers: Loggers of the new run.
    """
    for row in csv.DictReader(io.StringIO(earlier.content.get(METRICS_KEY, ""))):
        values = {name: _number(text) for name, text in row.items() if text}
        step = int(values.pop("step"))
        for one in loggers:
            one.log_metrics(values, step)


def _number(text: str) -> float:
    """The number; a whole one stays whole."""
    return int(text) if text.lstrip("-").isdigit() else float(text)


def _settings(config: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Yield the settings that must match, by their dotted names."""
    for name in MUST_MATCH:
        node: Any = config
        for key in name.split("."):
            node = node.get(key)
        yield from _leaves(name, node)


def _difference(key: str, before: Mapping[str, object], now: Mapping[str, object]) -> str:
    """A setting that is another than it was, or that one of both runs lacks."""
    if key not in before:
        return f"{key} was absent, is {now[key]} (~{key} leaves it out)"
    return f"{key} was {before[key]}, is {now.get(key, 'absent')}"


def _leaves(name: str, node: object) -> Iterator[tuple[str, object]]:
    if not isinstance(node, Mapping):
        yield name, node
        return
    for key, value in node.items():
        if key not in OF_THE_MACHINE:
            yield from _leaves(f"{name}.{key}", value)
