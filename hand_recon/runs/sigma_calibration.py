"""Factor of a network's σ in its checkpoints, fitted on validation hands of the same epoch (decision 83)."""

from typing import Any, Final

import lightning
import torch

from hand_recon.training.module import HandReconstruction
from hand_recon.uncertainty.sigma_factor import sigma_factor

SIGMA_FACTOR_KEY: Final = "hand_recon_sigma_factor"
"""Key of the factor in a checkpoint; older checkpoints have none, which is 1."""


class SigmaInCheckpoint(lightning.Callback):
    """Write the factor of σ into every checkpoint.

    It is that of the validation hands with the checkpoint's weights. A data term that does not learn σ, or
    that has not begun to, has the factor 1. A continued run has the factor of the checkpoint that it goes on
    from until its first validation.
    """

    def __init__(self) -> None:
        super().__init__()
        self.factor = 1.0

    def on_validation_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Fit the factor, before the module resets its scores."""
        if isinstance(pl_module, HandReconstruction):
            self.factor = factor_of(pl_module)

    def on_load_checkpoint(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        checkpoint: dict[str, Any],
    ) -> None:
        """Take over the factor: a run with nothing left to do validates no more, and saves."""
        self.factor = float(checkpoint.get(SIGMA_FACTOR_KEY, 1.0))

    def on_save_checkpoint(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        checkpoint: dict[str, Any],
    ) -> None:
        """Add the entry."""
        checkpoint[SIGMA_FACTOR_KEY] = self.factor


def factor_of(module: HandReconstruction) -> float:
    """Factor of σ by the validation scores that a module holds.

    Args:
        module: The module at the end of a validation.
    """
    term, calibration = module.data_term, module.validation.calibration
    if calibration is None or not term.learns_sigma or term.stage < term.stages - 1:
        return 1.0
    # The hands of all processes.
    with calibration.sync_context():
        residual, log_sigma = calibration.distinct("residual"), calibration.distinct("log_sigma")
        noise = calibration.distinct("label_noise").nan_to_num(0.0)
    known = residual.isfinite()
    given = noise.repeat_interleave(2, dim=1)[known] if module.label_sigma == "given" else None
    return sigma_factor(residual[known], torch.exp(log_sigma)[known], given)
