"""Means of the training losses over an epoch, which a checkpoint in its middle keeps (decision 88)."""

from typing import Any, Final

import lightning

from hand_recon.processes import process_group
from hand_recon.training.mean_losses import MeanLosses

LOSSES: Final = "losses"
"""Key of the detached losses, by name, in what a training step returns."""

OF_PROCESSES: Final = "of_processes"
"""Key of the sums of each process, by rank, in a state."""


class EpochLosses(lightning.Callback):
    """Log the mean of each training loss over the hands of an epoch, as `train/<name>`.

    Lightning's own means are not in its checkpoints.
    """

    def __init__(self) -> None:
        super().__init__()
        self.losses = MeanLosses()

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: Any,  # noqa: ANN401
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Add a batch's losses, weighted by its hands."""
        self.losses.add(outputs[LOSSES], len(batch))

    def on_train_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Log the means over the epoch and all processes, and begin anew."""
        for name, mean in self.losses.means().items():
            pl_module.log(f"train/{name}", mean, prog_bar=name == "loss")
        self.losses.reset()

    def state_dict(self) -> dict[str, Any]:
        """The sums of the epoch so far, of each process."""
        own = self.losses.state()
        if process_group.count() > 1:
            own["sums"] = {name: value.cpu() for name, value in own["sums"].items()}
        return {OF_PROCESSES: process_group.gathered(own)}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from the sums of a checkpoint."""
        if OF_PROCESSES not in state_dict:
            raise ValueError(
                "This checkpoint is of an earlier version, which kept the losses of an epoch in another "
                "form. Continue it with the version that saved it, or begin anew without resume=."
            )
        self.losses.restore(state_dict[OF_PROCESSES][process_group.rank()])
