"""Finds the newest unfinished training of a configuration, for `resume=auto`."""

import json
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from omegaconf import DictConfig

from hand_recon.runs.checkpoint_writer import LAST
from hand_recon.runs.configuration import plain
from hand_recon.runs.unfinished import MARK, is_in_use

logger = logging.getLogger(__name__)

_WITHOUT_EFFECT: Final = frozenset(
    {
        "callbacks", "checkpoint", "logger", "paths", "report", "resume", "threads", "workers", "cache_dir",
        "render_workers", "keep", "sizes", "default_root_dir", "wait_minutes",
    }
)  # fmt: skip
"""Settings, at any depth, on which the numbers of a training do not depend."""


def training_settings(config: DictConfig) -> dict[str, Any]:
    """Settings that tell trainings apart, as JSON holds them.

    Args:
        config: `conf/train.yaml`, composed.
    """
    settings: dict[str, Any] = json.loads(json.dumps(_kept(plain(config)), default=str))
    return settings


def _kept(node: object) -> object:
    if isinstance(node, Mapping):
        return {str(key): _kept(value) for key, value in node.items() if key not in _WITHOUT_EFFECT}
    return node


def newest_unfinished(config: DictConfig) -> Path | None:
    """Folder of the newest run of the same configuration that is unfinished and has a checkpoint.

    Args:
        config: Of the new run; runs below its `paths.output` are looked at, sweeps included.

    Returns:
        None if there is none, or if each of them is still going on.
    """
    wanted = training_settings(config)
    output = Path(config.paths.output).expanduser()
    found = [folder for folder in _unfinished(output) if _settings_in(folder / MARK) == wanted]
    idle = [folder for folder in found if not is_in_use(folder)]
    for folder in set(found) - set(idle):
        logger.info("%s is of the same configuration, and another process trains it.", folder)
    if not idle:
        logger.info(
            "No unfinished run of this configuration with a checkpoint in %s: a new run.", output
        )
        return None
    return max(idle, key=lambda folder: (folder / "checkpoints" / LAST).stat().st_mtime_ns)


def _unfinished(output: Path) -> Iterator[Path]:
    """Folders of unfinished runs with a last checkpoint: of commands, and of the runs of sweeps."""
    for pattern in (f"*/*/{MARK}", f"*/*/*/{MARK}"):
        for mark in output.glob(pattern):
            if (mark.parent / "checkpoints" / LAST).is_file():
                yield mark.parent


def _settings_in(mark: Path) -> object:
    try:
        return json.loads(mark.read_text(encoding="utf-8")).get("training")
    except (ValueError, AttributeError):
        return None
