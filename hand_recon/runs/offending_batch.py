"""Saves the batch whose loss was no number, to look at and to repeat the step with."""

from dataclasses import fields
from pathlib import Path
from typing import Final

import torch

from hand_recon.training.non_finite import NonFiniteLossError

OFFENDING_BATCH: Final = "non_finite_batch.pt"
"""File in the run's folder: `step`, `losses`, and every tensor of the batch by its name."""


def save_batch(error: NonFiniteLossError, folder: Path) -> Path:
    """Write the batch into a run's folder.

    Args:
        error: Has the batch as the step saw it, augmented.
        folder: The run's.

    Returns:
        The file, which `torch.load` reads with `weights_only=True`.
    """
    batch = error.batch.to("cpu")
    values = {field.name: getattr(batch, field.name) for field in fields(batch)}
    # A network's estimate is a record of its own, for fits alone.
    held = {name: value for name, value in values.items() if name != "estimate"}
    file = folder / OFFENDING_BATCH
    torch.save({"step": error.step, "losses": error.losses, **held}, file)
    return file
