"""Tells a search the score of each validation of a trial, and ends trials that the pruner gives up."""

import json
import logging
import math
from pathlib import Path

import lightning

from hand_recon.sweeps.search.study import PRUNED, SEARCH_FILE, open_study, trial_of

logger = logging.getLogger(__name__)


class ReportToSearch(lightning.Callback):
    """Reports the objective after each validation, and stops the training if the pruner says so.

    Args:
        folder: Folder of the search.
        trial: Number of the trial.
    """

    def __init__(self, folder: str | Path, trial: int) -> None:
        super().__init__()
        self.folder, self.number = Path(folder), trial
        settings = json.loads((self.folder / SEARCH_FILE).read_text(encoding="utf-8"))
        self.objective = str(settings["objective"])

    def on_validation_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Report the objective.

        Raises:
            ValueError: There is no such score.
        """
        if trainer.sanity_checking or not trainer.is_global_zero:
            return
        if self.objective not in trainer.callback_metrics:
            known = sorted(name for name in trainer.callback_metrics if name.startswith("val/"))
            raise ValueError(
                f"search.objective={self.objective}, which the validation hands have no score of. Known: "
                f"{', '.join(known)}."
            )
        value = float(trainer.callback_metrics[self.objective])
        trial = trial_of(open_study(self.folder), self.number)
        epoch = trainer.current_epoch
        known_values = trial.study.get_trials(deepcopy=False)[self.number].intermediate_values
        # A trial that was interrupted and goes on may come to the same epoch twice.
        if epoch not in known_values and math.isfinite(value):
            trial.report(value, epoch)
        if trial.should_prune():
            logger.info("Trial %d ends at epoch %d: others are better there.", self.number, epoch)
            trial.set_user_attr(PRUNED, epoch)
            trainer.should_stop = True
