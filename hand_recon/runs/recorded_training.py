"""`hand-recon train`: a training with its provenance, or one that repeats another run (decision 96)."""

from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from hand_recon.runs.provenance.machine import Meter
from hand_recon.runs.provenance.record import add_used
from hand_recon.runs.repeating import compare, settings_to_repeat
from hand_recon.runs.training_run import train


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
        add_used(Path(config.paths.run), meter.used())
