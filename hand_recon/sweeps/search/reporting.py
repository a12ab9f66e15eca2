"""Tells a search the score of each validation of a trial, and ends trials that the pruner gives up."""

import json
import logging
import math
from collections.abc import Mapping
from pathlib import Path

import lightning

from hand_recon.processes.process_group import gathered, rank
from hand_recon.sweeps.search.study import PRUNED, SEARCH_FILE, open_study, trial_of

logger = logging.getLogger(__name__)


class ReportToSearch(lightning.Callback):
    """Report the objective after each validation, and stop the training if the pruner says so.

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
        """Report the objective, and stop the training if the pruner says so.

        The first of the processes that train together reports; all of them stop, or have its error.

        Raises:
            ValueError: There is no such score.
        """
        if trainer.sanity_checking:
            return
        scores = {name: float(value) for name, value in trainer.callback_metrics.items()}
        verdict = self._verdict(trainer.current_epoch, scores) if rank() == 0 else None
        first = gathered(verdict)[0]
        if isinstance(first, Exception):
            raise first
        if first:
            trainer.should_stop = True

    def _verdict(self, epoch: int, scores: Mapping[str, float]) -> bool | Exception:
        """True if the training is to stop; an error as a value, since the other processes wait for it."""
        try:
            return self.tell(epoch, scores)
        except ValueError as error:
            return error
        except Exception as error:  # noqa: BLE001  # Optuna's, of the disk or the journal
            # Others may not survive the way to another process.
            return OSError(f"The search in {self.folder} cannot be told a score: {error}")

    def tell(self, epoch: int, scores: Mapping[str, float]) -> bool:
        """Report the objective after an epoch; true if the training is to stop.

        Raises:
            ValueError: There is no such score.
        """
        if self.objective not in scores:
            known = sorted(name for name in scores if name.startswith("val/"))
            raise ValueError(
                f"search.objective={self.objective}, which the validation hands have no score of. Known: "
                f"{', '.join(known)}."
            )
        trial = trial_of(open_study(self.folder), self.number)
        known_values = trial.study.get_trials(deepcopy=False)[self.number].intermediate_values
        # A trial that was interrupted and goes on may come to the same epoch twice.
        if epoch not in known_values and math.isfinite(scores[self.objective]):
            trial.report(scores[self.objective], epoch)
        if not trial.should_prune():
            return False
        logger.info("Trial %d ends at epoch %d: others are better there.", self.number, epoch)
        trial.set_user_attr(PRUNED, epoch)
        return True
