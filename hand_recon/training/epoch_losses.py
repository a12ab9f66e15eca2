"""Means of the training losses over an epoch, which a checkpoint in its middle keeps (decision 88)."""

from typing import Any, Final

import lightning
from torch import Tensor

from hand_recon import process_group

LOSSES: Final = "losses"
"""Key of the detached losses, by name, in what a training step returns."""


OF_PROCESSES: Final = "of_processes"
"""Key of the sums of each process, by rank, in a state; one process alone has its own without it."""


class EpochLosses(lightning.Callback):
    """Log the mean of each training loss over the hands of an epoch, as `train/<name>`.

    Lightning's own means are not in its checkpoints. The sums stay on the device until the epoch ends.
    """

    def __init__(self) -> None:
        super().__init__()
        self.sums: dict[str, Tensor] = {}
        self.count = 0

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: Any,  # noqa: ANN401
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Add a batch's losses, weighted by its hands."""
        size = len(batch)
        self.count += size
        for name, value in outputs[LOSSES].items():
            total = value * size
            before = self.sums.get(name)
            self.sums[name] = total if before is None else before.to(total) + total

    def on_train_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Log the means over the epoch and all processes, and begin anew."""
        for name, total in self.sums.items():
            pl_module.log(
                f"train/{name}", total / self.count, prog_bar=name == "loss", sync_dist=True
            )
        self.sums, self.count = {}, 0

    def state_dict(self) -> dict[str, Any]:
        """The sums of the epoch so far, of each process."""
        own = {"sums": self.sums, "count": self.count}
        if process_group.count() == 1:
            return own
        on_the_processor = {name: value.cpu() for name, value in self.sums.items()}
        return {OF_PROCESSES: process_group.gathered(own | {"sums": on_the_processor})}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from the sums of a checkpoint."""
        if OF_PROCESSES in state_dict:
            state_dict = state_dict[OF_PROCESSES][process_group.rank()]
        self.sums, self.count = dict(state_dict["sums"]), int(state_dict["count"])
