"""Saves the last checkpoint: by steps, by time, on SIGTERM, and where training can go on (decision 88)."""

import logging
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

import lightning
import torch
from lightning.pytorch.callbacks import Checkpoint
from lightning.pytorch.loggers import CSVLogger

from hand_recon.data.sample_order import ResumableLoader
from hand_recon.processes import process_group
from hand_recon.runs.checkpoint_writer import LAST, METRICS_KEY, POSITION_KEY

logger = logging.getLogger(__name__)

TERMINATED: Final = 128 + signal.SIGTERM
"""Exit status after SIGTERM, 143: that of a process which SIGTERM ended."""

VALIDATION_GRACE: Final = 2.0
"""Seconds after SIGTERM in which a validation may still end; then the checkpoint before it has to do."""


class LastCheckpoint(Checkpoint):
    """Save `last.ckpt` with everything that training needs to go on in the middle of an epoch.

    It is saved after a batch that is not the last of its epoch, so that no validation is half done: the first
    after each validation, and those that the intervals ask for; and at the end of training. After SIGTERM it
    is saved after the running batch, and the process ends with status 143. Where epochs have a single batch,
    it is saved at the end alone.

    Args:
        folder: Folder of the checkpoints.
        every_n_steps: Optimizer steps between two; none for no such interval.
        every_minutes: Minutes between two; none for no such interval.

    Raises:
        ValueError: An interval is not positive.
    """

    def __init__(
        self,
        folder: str | Path,
        every_n_steps: int | None = None,
        every_minutes: float | None = None,
    ) -> None:
        super().__init__()
        if min(every_n_steps or 1, every_minutes or 1) <= 0 or every_n_steps == 0:
            raise ValueError(
                f"checkpoint.every_n_steps={every_n_steps} and checkpoint.every_minutes={every_minutes} must "
                "be positive, or null for no such interval."
            )
        self.file = Path(folder) / LAST
        self.every_n_steps = every_n_steps
        self.every_minutes = every_minutes
        self._saved_at = 0.0
        self._saved_step = -1
        self._step_before = 0
        self._owed = False
        self._terminated: float | None = None
        self._handler: Any = None
        self._position: dict[str, int] | None = None

    def on_train_start(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Start the clock, and from now on note SIGTERM instead of ending at once."""
        self._saved_at, self._saved_step = time.monotonic(), trainer.global_step
        # Lightning restores a loader only if nothing asked for the number of steps before.
        if self._position is not None and isinstance(trainer.train_dataloader, ResumableLoader):
            trainer.train_dataloader.load_state_dict(self._position)
        if threading.current_thread() is threading.main_thread():
            self._handler = signal.signal(signal.SIGTERM, self._note)

    def on_train_batch_start(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Note the step, which a batch of accumulated gradients leaves as it is."""
        self._step_before = trainer.global_step

    def on_train_batch_end(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: Any,  # noqa: ANN401
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Save if it is time to, and end the process if it is to end."""
        step = trainer.global_step
        if self.every_n_steps is not None and step % self.every_n_steps == 0:
            self._owed = True
        if _validates_next(trainer, batch_idx) or step == self._step_before:
            # Epochs of a single batch have no batch after which it can be saved.
            if trainer.num_training_batches == 1:
                self._end_if_terminated(trainer)
            return
        if process_group.in_any_process(self._due()):
            self._save(trainer, pl_module)
        self._end_if_terminated(trainer)

    def on_validation_batch_end(  # noqa: PLR0917  # Lightning's signature
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        outputs: Any,  # noqa: ANN401
        batch: Any,  # noqa: ANN401
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """End a long validation: training goes on from the checkpoint before it."""
        since = self._terminated
        late = since is not None and time.monotonic() - since > VALIDATION_GRACE
        if process_group.in_any_process(late):
            self._end_if_terminated(trainer)

    def on_validation_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Ask for a checkpoint that has this validation."""
        self._owed = self._owed or not trainer.sanity_checking

    def on_train_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule
    ) -> None:
        """Save the end of training."""
        self._save(trainer, pl_module)
        self._restore_handler()
        self._end_if_terminated(trainer)

    def on_exception(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        exception: BaseException,
    ) -> None:
        """Leave SIGTERM to whoever had it before."""
        self._restore_handler()

    def on_save_checkpoint(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        checkpoint: dict[str, Any],
    ) -> None:
        """Add the place in the epoch, and the scalars logged so far, since their file may be ahead of it."""
        if isinstance(trainer.train_dataloader, ResumableLoader):
            checkpoint[POSITION_KEY] = trainer.train_dataloader.state_dict()
        for one in trainer.loggers:
            if isinstance(one, CSVLogger):
                one.save()
                file = Path(one.log_dir) / "metrics.csv"
                checkpoint[METRICS_KEY] = file.read_text() if file.exists() else ""

    def on_load_checkpoint(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        checkpoint: dict[str, Any],
    ) -> None:
        """Keep the place in the epoch until there is a loader."""
        self._position = checkpoint.get(POSITION_KEY)

    def _due(self) -> bool:
        elapsed = time.monotonic() - self._saved_at
        late = self.every_minutes is not None and elapsed >= 60 * self.every_minutes
        return late or self._owed or self._terminated is not None

    def _save(self, trainer: lightning.Trainer, module: lightning.LightningModule) -> None:
        """Save, unless a weight is no number: the next step says so, and the last good one is kept."""
        finite = all(torch.isfinite(weight).all() for weight in module.parameters())
        if not finite or getattr(trainer, "fast_dev_run", False):
            return
        trainer.save_checkpoint(self.file)
        self._saved_at, self._saved_step = time.monotonic(), trainer.global_step
        self._owed = False

    def _note(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._terminated = self._terminated or time.monotonic()

    def _end_if_terminated(self, trainer: lightning.Trainer) -> None:
        """End the process, if one of the processes was told to.

        Raises:
            SystemExit: With status 143.
        """
        if not process_group.in_any_process(self._terminated is not None):
            return
        logger.warning(
            "SIGTERM at step %d; %s is of step %d. The same command with resume=%s goes on.",
            trainer.global_step, self.file.name, self._saved_step, self.file.parent.parent,
        )  # fmt: skip
        raise SystemExit(TERMINATED)

    def _restore_handler(self) -> None:
        if self._handler is not None:
            signal.signal(signal.SIGTERM, self._handler)
            self._handler = None


def _validates_next(trainer: lightning.Trainer, batch_idx: int) -> bool:
    """True after the last batch of an epoch, and before a validation in its middle."""
    interval = trainer.val_check_batch
    within = interval is not None and (batch_idx + 1) % interval == 0
    return trainer.is_last_batch or (trainer.enable_validation and within)


@contextmanager
def sigterm_ends_the_process() -> Iterator[None]:
    """In the block, SIGTERM ends the process with status 143, as an exception that lets files be closed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
