"""`hand-recon train`: a training with its provenance, or one that repeats another run (decision 96)."""

import logging
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from hand_recon.command_line.launched import launched_place
from hand_recon.runs.provenance.machine import Meter
from hand_recon.runs.provenance.record import add_used
from hand_recon.runs.repeating import compare, settings_to_repeat
from hand_recon.runs.training_run import train

logger = logging.getLogger(__name__)


def train_recorded(config: DictConfig) -> dict[str, Any]:
    """Train, and add time and memory to the run's folder; with `from_run`, repeat that run and compare.

    Args:
        config: `conf/train.yaml`, composed.

    Returns:
        What `metrics.json` holds.

    Raises:
        ValueError: The repeated run's losses are others, or it cannot be repeated here.
    """
    repeated = config.get("from_run")
    if repeated is None:
        return _recorded(config)
    told = settings_to_repeat(config)
    metrics = _recorded(told.config)
    # Only the first of several processes has metrics.
    if metrics:
        compare(told)
    return metrics


def _recorded(config: DictConfig) -> dict[str, Any]:
    meter = Meter()
    try:
        return train(config)
    finally:
        # One folder for all processes, of which the first alone writes.
        if launched_place().rank == 0:
            _add_used(Path(config.paths.run), meter)


def _add_used(folder: Path, meter: Meter) -> None:
    """Add time and memory; a disk that refuses them does not hide why the training ended."""
    try:
        add_used(folder, meter.used())
    except OSError as error:
        logger.warning("Time and memory could not be added to the run's record: %s", error)
