"""Progress of a training run: a live bar on a terminal, plain lines in a log."""

import logging
import sys
import time
import warnings

import lightning
from lightning.pytorch.callbacks import RichProgressBar

logger = logging.getLogger(__name__)

_LINES_PER_RUN = 40


def is_interactive() -> bool:
    """True if the output goes to a terminal."""
    return sys.stderr.isatty()


def quiet_libraries() -> None:
    """Silence the libraries' advertisements and their own deprecation warnings."""
    for name in ("lightning.pytorch.utilities.rank_zero", "lightning.pytorch.accelerators.cuda"):
        logging.getLogger(name).setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=r".*treespec, LeafSpec", module="lightning")
    # A continued run's folder has the checkpoints of the run before.
    warnings.filterwarnings("ignore", message=r"Checkpoint directory .* exists and is not empty")
    # Scores are those of the hands of all processes already.
    warnings.filterwarnings("ignore", message=r"It is recommended to use `self\.log\(")
    # Frozen layers are in evaluation mode on purpose.
    warnings.filterwarnings("ignore", message=r"Found \d+ module\(s\) in eval mode")


def progress_callback() -> lightning.Callback:
    """A progress bar on a terminal, one line per epoch elsewhere."""
    return RichProgressBar(leave=False) if is_interactive() else PlainProgress()


class PlainProgress(lightning.Callback):
    """Log one line per epoch: losses and scores, time, and time left.

    With many epochs, some forty lines for the whole run.
    """

    def __init__(self) -> None:
        super().__init__()
        self._started = 0.0
        self._first_epoch = 0

    def on_train_start(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Start the clock."""
        self._started = time.monotonic()
        self._first_epoch = trainer.current_epoch

    def on_train_epoch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Write the line."""
        done, total = trainer.current_epoch + 1, trainer.max_epochs or 0
        if done % max(1, total // _LINES_PER_RUN) and done != total:
            return
        elapsed = time.monotonic() - self._started
        left = elapsed / (done - self._first_epoch) * (total - done)
        shown = ("train/loss", "val/loss", "val/E_J", "val/E_V", "val/E_2D")
        values = "  ".join(
            f"{name} {float(trainer.callback_metrics[name]):.4g}"
            for name in shown
            if name in trainer.callback_metrics
        )
        logger.info("epoch %d/%d  %s  %.0f s, %.0f s to go", done, total, values, elapsed, left)
