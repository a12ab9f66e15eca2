"""Random draws of a training step as a function of the run's seed and the step (decision 88)."""

import zlib
from typing import Any

import lightning
import torch


class SeededSteps(lightning.Callback):
    """Seed torch's global generators at each training step by the seed, the process and the step.

    Dropout, the hidden landmarks and the noise of given ones draw from them. A resumed run draws what the
    uninterrupted one would have drawn, without a generator's state in the checkpoint.

    Args:
        seed: Seed of the run.
    """

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.seed = seed

    def on_train_batch_start(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Seed the generators of the processor and of the accelerators."""
        key = (self.seed, trainer.global_rank, trainer.fit_loop.total_batch_idx)
        torch.manual_seed(zlib.crc32(repr(key).encode()))
