"""Scores of a run that leaves the test hands alone: of its best checkpoint, on the validation hands."""

from typing import TYPE_CHECKING, Any

import torch

from hand_recon.data.augment import to_float

if TYPE_CHECKING:
    from hand_recon.runs.results import Run


@torch.no_grad()
def validation_scores(run: "Run") -> dict[str, float]:
    """Scores of a trained module on all validation hands, in single precision."""
    device = (
        "cuda" if torch.cuda.is_available() and run.config.trainer.accelerator != "cpu" else "cpu"
    )
    module = run.module.to(device).eval()
    run.data.setup("validate")
    module.validation.reset()
    for loaded in run.data.val_dataloader():
        batch = to_float(loaded.to(device))
        module.validation.update(batch, module(batch))
    return {name: float(value) for name, value in module.validation.compute().items()}


def untested(run: "Run", environment: dict[str, Any]) -> dict[str, Any]:
    """Entries of `metrics.json` of a run without a test."""
    return {
        "name": run.config.name,
        "data": run.data.name,
        "landmarks": run.data.landmark_set,
        "validation": validation_scores(run),
        **run.facts,
        "environment": environment,
    }
