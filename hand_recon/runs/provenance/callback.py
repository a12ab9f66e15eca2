"""Writes the provenance of a run into its folder when its training begins."""

from pathlib import Path

import lightning

from hand_recon.runs.checkpoints import ConfigInCheckpoint
from hand_recon.runs.provenance.record import provenance, write_provenance


class Provenance(lightning.Callback):
    """Write code, packages, data and machine when training begins, by the first process.

    Args:
        folder: The run's.
    """

    def __init__(self, folder: str | Path) -> None:
        super().__init__()
        self.folder = Path(folder)

    def on_fit_start(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Write them."""
        callbacks = trainer.callbacks  # type: ignore[attr-defined]
        config = next(
            (one.config for one in callbacks if isinstance(one, ConfigInCheckpoint)), None
        )
        if trainer.is_global_zero and config is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_provenance(self.folder, *provenance(config))
