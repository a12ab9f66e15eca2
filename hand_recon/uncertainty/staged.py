"""The schedule of the data term: the squared error first, then the likelihood (Sec. 4.1).

The paper gives the reason, "for faster convergence", but not the time of the switch. At the switch, σ should
start at the RMS residual: a gradient of 2e becomes e / σ², so the data term keeps 1 / (2σ²) of its weight
against the prior (all of it with `keep_balance`). An untrained σ would make it explode or vanish.
"""

import math
from typing import Any, Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.processes import process_group
from hand_recon.uncertainty.bounds import LOWEST_SIGMA
from hand_recon.uncertainty.data_term import DataTerm

RUNNING_DECAY: Final = 0.99
"""EMA decay per step; the running residual covers about a hundred steps."""

UNKNOWN_LOG_SIGMA: Final = 1.5
"""log σ before any residual was seen: 4.5 px, the initial σ of the regressor."""

UNITS: Final = ("share", "epoch", "step")
"""Units of the time of the switch."""


class RunningResidual(nn.Module):
    """Exponential moving average of the squared residual of each labelled coordinate."""

    squares: Tensor
    counts: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("squares", torch.zeros(21, 2))
        self.register_buffer("counts", torch.zeros(21))

    @torch.no_grad()
    def update(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
    ) -> None:
        """Add the residuals of a step, of all processes.

        Args:
            residual: Projection minus label, pixels; anything where unlabelled.
            labelled: Landmarks that have a label.
        """
        squared = residual.masked_fill(~labelled[..., None], 0.0).square()
        new = squared.reshape(-1, 21, 2).sum(dim=0), labelled.reshape(-1, 21).sum(dim=0)
        sums = process_group.summed(torch.cat([new[0], new[1][:, None].to(squared)], dim=1))
        # Sum and count decay alike, so that neither the start nor rare labels bias the mean.
        self.squares.mul_(RUNNING_DECAY).add_(sums[:, :2])
        self.counts.mul_(RUNNING_DECAY).add_(sums[:, 2])

    def log_sigma(self) -> Float[Tensor, "landmark=21 2"]:
        """Logarithm of the running RMS, pixels, at least that of `LOWEST_SIGMA`.

        A landmark that never had a label has the RMS of those that had.
        """
        if not self.counts.any():
            return torch.full_like(self.squares, UNKNOWN_LOG_SIGMA)
        overall = self.squares.sum() / (2 * self.counts.sum())
        mean = self.squares / self.counts[:, None].clamp(min=torch.finfo(self.counts.dtype).tiny)
        mean = torch.where(self.counts[:, None] > 0, mean, overall)
        return 0.5 * mean.clamp(min=LOWEST_SIGMA**2).log()


class Staged(DataTerm):
    """Two data terms, one before and one after a switch during the run.

    The current stage and the running residuals are part of the state, so a resumed run continues exactly and
    a loaded checkpoint has the loss that it was trained with. A buffer that is written in place, as some
    averages of weights do, does not change the stage: load a state instead.

    Args:
        first: Data term before the switch; the squared error in the paper.
        second: Data term after the switch; Eq. 7 in the paper.
        switch_at: Time of the switch, in `unit`s; above zero.
        unit: `share` of the run's steps (below one), or a number of finished `epoch`s or of `step`s.
        keep_balance: Whether to multiply the second stage by the ratio of the gradients, 2σ̄² for Eq. 7, where
            σ̄ is the RMS of the residuals at the switch. Landmarks are then weighted against each other as in
            Eq. 7, and all of them against the prior as in the first stage. Without it, the second stage is
            Eq. 7 to the letter, and the prior's relative weight grows by 2σ̄² (decision 29).

    Raises:
        ValueError: The unit is unknown, or the time leaves no first stage or no second one.
    """

    stages = 2
    switched: Tensor
    factor: Tensor

    def __init__(
        self,
        first: DataTerm,
        second: DataTerm,
        *,
        switch_at: float,
        unit: str = "share",
        keep_balance: bool = False,
    ) -> None:
        super().__init__()
        _check_time(switch_at, unit)
        self.first = first
        self.second = second
        self.switch_at = switch_at
        self.unit = unit
        self.needs_correlation = first.needs_correlation or second.needs_correlation
        self.learns_sigma = second.learns_sigma
        self.running = RunningResidual()
        self.keep_balance = keep_balance
        # The stage is asked for in every step, and a device would have to be waited for.
        self._stage = 0
        self.register_buffer("switched", torch.tensor(False))
        self.register_buffer("factor", torch.tensor(1.0))

    @property
    def stage(self) -> int:
        """0 before the switch, 1 after it."""
        return self._stage

    def _load_from_state_dict(self, *arguments: Any, **named: Any) -> None:  # noqa: ANN401
        """Take the stage of a checkpoint with the rest."""
        super()._load_from_state_dict(*arguments, **named)
        self._stage = int(self.switched)

    def begin(self, *, step: int, epoch: int, total_steps: int) -> bool:
        """Switch to the second stage if its time has come; called before every training step.

        Args:
            step: Optimizer steps that the run has made.
            epoch: Epochs that it has finished.
            total_steps: Optimizer steps that it will have made at its end.

        Returns:
            True if this call made the switch, once in a run.

        Raises:
            ValueError: The switch is at a share of a run without a known end.
        """
        if self.stage == 1 or not self._due(step, epoch, total_steps):
            return False
        self.switched.fill_(True)
        self._stage = 1
        start = self.running_log_sigma()
        self.second.start(start)
        if self.keep_balance:
            self.factor.fill_(self.second.balance(float(torch.exp(2 * start).mean())))
        return True

    def observe(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
    ) -> None:
        """Add the residuals of a training step to the running mean.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; anything where unlabelled.
            labelled: Landmarks that have a label.
        """
        self.running.update(residual, labelled)

    def running_log_sigma(self) -> Float[Tensor, "landmark=21 2"]:
        """Logarithm of the running RMS of each coordinate's residual, pixels."""
        return self.running.log_sigma()

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Cost of each landmark by the term of the current stage."""
        if self.stage == 0:
            return self.first.cost(residual, log_sigma, correlation)
        return self.factor * self.second.cost(residual, log_sigma, correlation)

    def _due(self, step: int, epoch: int, total_steps: int) -> bool:
        if self.unit == "epoch":
            return epoch >= self.switch_at
        if self.unit == "step":
            return step >= self.switch_at
        if total_steps <= 0:
            raise ValueError(
                f"The switch is at {self.switch_at:.0%} of the run, but the run has no known end "
                f"(total_steps={total_steps}). Give it one (trainer.max_epochs or max_steps), or say "
                "data_term.unit=epoch or step."
            )
        # In binary, 0.07 · 100 is slightly more than 7, and without rounding the eighth step would be meant.
        return step >= math.ceil(round(self.switch_at * total_steps, 6))


def _check_time(switch_at: float, unit: str) -> None:
    if unit not in UNITS:
        raise ValueError(f"The switch is counted in one of {', '.join(UNITS)}, found {unit!r}.")
    if not switch_at > 0:
        raise ValueError(
            f"A switch at {switch_at} leaves no first stage. Use the second term by itself "
            "(data_term=nll), or a later switch."
        )
    if unit == "share" and switch_at >= 1:
        raise ValueError(
            f"A switch at {switch_at} of the run never comes. Use the first term by itself "
            "(data_term=mse), a share below 1, or unit=epoch or step."
        )
