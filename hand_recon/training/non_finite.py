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


class Arriving:
    """A value of a device that is copied to the processor while the device goes on.

    Args:
        value: A single value, on any device.
    """

    def __init__(self, value: Tensor) -> None:
        # From CUDA, the copy goes to pinned memory, and nothing waits for it. Other devices have no event.
        self._copy = value.detach().to("cpu", non_blocking=value.is_cuda)
        self._arrived = torch.cuda.Event() if value.is_cuda else None
        if self._arrived is not None:
            self._arrived.record(torch.cuda.current_stream(value.device))

    def read(self) -> bool:
        """The value; waits for what the device did before it was copied, and not for what it does after."""
        if self._arrived is not None:
            self._arrived.synchronize()
        return bool(self._copy)


class LossGuard:
    """Refuses losses that are no numbers: at once on a processor, and a step later on a GPU.

    To ask a GPU for a loss at once would be to wait for it in every step. `settle` refuses what is not yet
    known; called before weights are saved, it keeps those that such a loss has changed from any file.
    """

    def __init__(self) -> None:
        self._latest: tuple[Arriving, dict[str, Tensor], HandBatch, int] | None = None

    def watch(self, losses: dict[str, Tensor], batch: HandBatch, step: int) -> None:
        """Check the loss of a step, or of the one before it; all processes refuse it together.

        Args:
            losses: Every term; the sum under `loss`.
            batch: The batch.
            step: Optimizer steps before it.

        Raises:
            NonFiniteLossError: The loss of a process is infinite or no number.
        """
        self.settle()
        detached = {name: value.detach() for name, value in losses.items()}
        self._latest = Arriving(torch.isfinite(detached["loss"])), detached, batch, step
        if not is_late(losses["loss"]):
            self.settle()

    def settle(self) -> None:
        """Check the loss that is not yet known, if there is one.

        Raises:
            NonFiniteLossError: The loss of a process is infinite or no number.
        """
        if self._latest is None:
            return
        (finite, losses, batch, step), self._latest = self._latest, None
        own = not finite.read()
        if process_group.in_any_process(own):
            raise _error(losses, batch, step, own=own)


def is_late(loss: Tensor) -> bool:
    """True where a loss is checked a step later, since reading it would stop a GPU's work."""
    return loss.is_cuda


def _error(
    losses: dict[str, Tensor], batch: HandBatch, step: int, *, own: bool
) -> NonFiniteLossError:
    values = {name: float(value) for name, value in losses.items()}
    return NonFiniteLossError(
        f"The loss is not finite at step {step}: {values}. The batch held {list(batch.source[:8])}. Lower "
        "the learning rate (optimizer.lr), or look at these samples.",
        batch, step, values, own=own,
    )  # fmt: skip
