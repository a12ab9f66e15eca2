"""Refusal of a loss that is no number, with the batch that caused it."""

import torch
from torch import Tensor

from hand_recon.processes import process_group
from hand_recon.schema import HandBatch


class NonFiniteLossError(FloatingPointError):
    """The loss of a training step is infinite or no number.

    Args:
        message: The losses and samples, and the remedy.
        batch: The batch as the step saw it, augmented.
        step: Optimizer steps before it.
        losses: Every term.
        own: False in a process whose own loss is finite, and that of another process is not.
    """

    def __init__(
        self,
        message: str,
        batch: HandBatch,
        step: int,
        losses: dict[str, float],
        *,
        own: bool = True,
    ) -> None:
        super().__init__(message)
        self.batch = batch
        self.step = step
        self.losses = losses
        self.own = own


def refuse_non_finite(losses: dict[str, Tensor], batch: HandBatch, step: int) -> None:
    """Check the loss of a step; all processes refuse it together, so that none waits for another.

    Args:
        losses: Every term; the sum under `loss`.
        batch: The batch.
        step: Optimizer steps before it.

    Raises:
        NonFiniteLossError: The loss of a process is infinite or no number.
    """
    own = not bool(torch.isfinite(losses["loss"]))
    if not process_group.in_any_process(own):
        return
    values = {name: float(value.detach()) for name, value in losses.items()}
    raise NonFiniteLossError(
        f"The loss is not finite at step {step}: {values}. The batch held {list(batch.source[:8])}. Lower "
        "the learning rate (optimizer.lr), or look at these samples.",
        batch, step, values, own=own,
    )  # fmt: skip
