"""Continues an interrupted run in a new folder, with the settings and the best checkpoint of the old one."""

import logging
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import lightning
from omegaconf import DictConfig

from hand_recon.runs.checkpoints import VERSION_KEY, read_checkpoint
from hand_recon.runs.configuration import plain, refuse_outdated

logger = logging.getLogger(__name__)

MUST_MATCH: Final = (
    "seed", "crop_size", "data", "hand", "model", "prior", "data_term", "supervision",
    "optimizer",
)  # fmt: skip
"""Settings that a continued run shares with the run that it continues."""

OF_THE_MACHINE: Final = frozenset(
    {"cache_dir", "root", "eval_root", "workers", "render_workers", "weights"}
)
"""Settings that may differ: paths of files and numbers of processes."""


@dataclass(frozen=True)
class Earlier:
    """The run that is continued."""

    last: Path
    """Last checkpoint."""
    best: Path
    """Best checkpoint."""
    score: float
    """Validation loss of the best checkpoint."""
    epochs: int
    """Finished epochs."""


def earlier_run(config: DictConfig) -> Earlier | None:
    """Find the run to continue and check that its settings are the same; None for a new run.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: It was trained with other settings.
    """
    if config.resume is None:
        return None
    path = Path(config.resume).expanduser()
    path = path / "checkpoints" / "last.ckpt" if path.is_dir() else path
    checkpoint, saved = read_checkpoint(path)
    refuse_outdated(saved, str(path), checkpoint.get(VERSION_KEY))
    before, now = dict(_settings(plain(saved))), dict(_settings(plain(config)))
    changed = sorted(key for key in before | now if before.get(key) != now.get(key))
    if changed:
        described = ", ".join(f"{key} was {before.get(key)}, is {now.get(key)}" for key in changed)
        raise ValueError(
            f"{path} was trained with other settings: {described}. A run is continued with the settings that "
            "it had (config.yaml in its folder lists them)."
        )
    scores = [
        float(state["best_model_score"])
        for name, state in checkpoint["callbacks"].items()
        if name.startswith("ModelCheckpoint")
    ]
    # A checkpoint holds the number of the epoch, from zero, at whose end it was written.
    return Earlier(path, path.with_name("best.ckpt"), min(scores), int(checkpoint["epoch"]) + 1)


def best_checkpoint(trainer: lightning.Trainer, folder: Path, earlier: Earlier | None) -> Path:
    """Find the best checkpoint of a run and of the one that it continued, in the run's own folder.

    Args:
        trainer: After training.
        folder: Of the run.
        earlier: What it continued.

    Raises:
        ValueError: Nothing was trained.
    """
    callback = trainer.checkpoint_callback
    found = Path(getattr(callback, "best_model_path", "") or "absent")
    score = getattr(callback, "best_model_score", None)
    # If no epoch was left to train, Lightning still has the path in the earlier folder.
    trained = found.is_relative_to(folder) and found.is_file()
    if not trained and earlier is None:
        raise ValueError(
            f"Nothing was trained in {trainer.max_epochs} epochs: give trainer.max_epochs=1 or more."
        )
    if earlier is None or (trained and score is not None and float(score) < earlier.score):
        return found
    if not earlier.best.is_file():
        raise ValueError(
            f"The best checkpoint so far, {earlier.best}, is gone, and nothing better was found. "
            "Score the last one with python -m hand_recon.evaluate ckpt=<folder>/checkpoints/last.ckpt"
        )
    logger.info("The best checkpoint is still that of %s.", earlier.best.parent.parent)
    kept = folder / "checkpoints" / "best_earlier.ckpt"
    kept.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(earlier.best, kept)
    if trained:
        found.rename(found.with_name("best_continued.ckpt"))
    return kept.rename(kept.with_name("best.ckpt"))


def _settings(config: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Yield the settings that must match, by their dotted names."""
    for key in MUST_MATCH:
        yield from _leaves(key, config.get(key))


def _leaves(name: str, node: object) -> Iterator[tuple[str, object]]:
    if not isinstance(node, Mapping):
        yield name, node
        return
    for key, value in node.items():
        if key not in OF_THE_MACHINE:
            yield from _leaves(f"{name}.{key}", value)
