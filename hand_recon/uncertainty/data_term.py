"""One value per hand from residuals and σ: the squared error, Eq. 7 and its relatives (Sec. 3.3).

A term is a sum over 42 coordinates in pixels of a 224-pixel crop: only so do the weights of the
prior mean what they do in the paper (decision 7).
"""

import math
from abc import ABC, abstractmethod
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from hand_recon.uncertainty import likelihoods
from hand_recon.uncertainty.bounds import soft_clamp

SAFE_LOG_SIGMA: Final = 10.0
"""Up to ± this, log σ is taken as it is; beyond, its exponential would soon leave single precision."""

SAFE_CORRELATION: Final = 0.995
"""Up to ± this, a correlation is taken as it is; at ±1 a covariance has no inverse."""

NEUTRAL_SIGMA: Final = math.sqrt(0.5)
"""Pixels: the σ for which 1 / (2σ²) is one."""


class DataTerm(nn.Module, ABC):
    """What training asks of every data term, whether or not it changes during a run."""

    needs_correlation: bool = False
    """Whether a correlation of each landmark's two coordinates must be predicted."""
    learns_sigma: bool = False
    """Whether the predicted σ means something in the end."""
    stages: int = 1
    """How many losses it has, one after the other."""

    @property
    def stage(self) -> int:
        """Which of the losses is at work, from 0."""
        return 0

    def forward(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
        correlation: Float[Tensor, "*batch landmark=21"] | None = None,
    ) -> Float[Tensor, "*batch"]:
        """One value per hand, finite with its gradient for every log σ.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; anything where unlabelled.
            log_sigma: Predicted logarithm of the standard deviation of each coordinate.
            labelled: Landmarks that have a label.
            correlation: Predicted correlation of each landmark's two coordinates, −1 to 1.

        Raises:
            ValueError: The term needs a correlation, and there is none.
        """
        # Masked before any arithmetic: a gradient of NaN stays NaN even times zero.
        residual = residual.masked_fill(~labelled[..., None], 0.0)
        log_sigma = soft_clamp(log_sigma, -SAFE_LOG_SIGMA - 1, SAFE_LOG_SIGMA + 1, margin=1.0)
        # And masked after it: log σ of a landmark without label is not to be made small.
        cost = self.cost(residual, log_sigma, correlation).masked_fill(~labelled, 0.0)
        # A hand with half its labels counts as much as one with all, so λ's keep their meaning.
        share = labelled.sum(dim=-1).clamp(min=1) / labelled.shape[-1]
        return cost.sum(dim=-1) / share

    @abstractmethod
    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """The two coordinates of each landmark together, from finite numbers."""

    def begin(self, *, step: int, epoch: int, total_steps: int) -> bool:
        """To be called before every training step; true if this very call changes the loss.

        Args:
            step: Optimizer steps that the run has made.
            epoch: Epochs that it has finished.
            total_steps: Optimizer steps that it will have made at its end.
        """
        return False

    def observe(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
    ) -> None:
        """To be called with every training step's residuals, for what depends on how large they are.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; anything where unlabelled.
            labelled: Landmarks that have a label.
        """

    def running_log_sigma(self) -> Float[Tensor, "landmark=21 2"]:
        """Logarithm of the running root mean square of each coordinate's residual, pixels.

        Raises:
            RuntimeError: The term has one stage, and so keeps no account of residuals.
        """
        raise RuntimeError(
            f"{type(self).__name__} has a single stage and keeps no running residual. Ask only when "
            "begin() has returned true, or use Staged."
        )

    def start(self, log_sigma: Float[Tensor, "landmark=21 2"]) -> None:
        """Told, when its stage begins, how large the residuals then are: log of their RMS, pixels."""

    def balance(self, variance: float) -> float:
        """What this term must be multiplied by to pull as hard as the squared error does.

        Args:
            variance: Mean square of the residuals, square pixels, which σ² has learnt to be.
        """
        return 2 * variance


class SquaredError(DataTerm):
    """The sum of squared residuals over the labelled coordinates (Sec. 4.1, the first stage)."""

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Square pixels; σ plays no part."""
        return residual.square().sum(dim=-1)


class RescaledSquaredError(DataTerm):
    """The squared error times 1 / (2σ̄²), with one σ̄ for all.

    Eq. 7 does two things at once: it weighs landmarks by their σ, and it makes the data term lighter
    against the prior. This does the second only, so that an ablation can tell them apart.

    Args:
        sigma: σ̄, pixels of a 224-pixel crop. As the second stage of `Staged` it is replaced by the
            RMS of the residuals at the switch; as it is given by default, nothing is rescaled.

    Raises:
        ValueError: σ̄ is not positive.
    """

    sigma: Tensor

    def __init__(self, sigma: float = NEUTRAL_SIGMA) -> None:
        super().__init__()
        if not sigma > 0:
            raise ValueError(f"A standard deviation is positive, found sigma={sigma} pixels.")
        self.register_buffer("sigma", torch.tensor(sigma))

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Square standard deviations, halved; the predicted σ plays no part."""
        return residual.square().sum(dim=-1) / (2 * self.sigma.square())

    def start(self, log_sigma: Float[Tensor, "landmark=21 2"]) -> None:
        """Take the RMS over all coordinates, the σ̄ that Eq. 7 would choose if it had but one."""
        self.sigma.copy_(torch.exp(2 * log_sigma).mean().sqrt())


class NegativeLogLikelihood(DataTerm):
    """Eq. 7, or β-NLL, which learns badly predicted landmarks faster (Seitzer et al., ICLR 2022).

    Args:
        beta: 0 for Eq. 7; 1 for means that learn as from the squared error.

    Raises:
        ValueError: β is not between 0 and 1.
    """

    learns_sigma = True

    def __init__(self, beta: float = 0.0) -> None:
        super().__init__()
        if not 0 <= beta <= 1:
            raise ValueError(
                f"beta lies between 0 (Eq. 7) and 1 (weights of the squared error), found {beta}."
            )
        self.beta = beta

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Without the constant; see `likelihoods.beta_gaussian`."""
        return likelihoods.beta_gaussian(residual, log_sigma, self.beta).sum(dim=-1)

    def balance(self, variance: float) -> float:
        """2σ^(2−2β): a gradient of e σ^(2β) / σ² against 2e."""
        return float(2 * variance ** (1 - self.beta))


class LaplaceLikelihood(DataTerm):
    """A Laplace distribution in place of Eq. 6's Gaussian: a wrong label pulls with bounded force."""

    learns_sigma = True

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Without the constant; see `likelihoods.laplace`."""
        return likelihoods.laplace(residual, log_sigma).sum(dim=-1)

    def balance(self, variance: float) -> float:
        """2σ²/√π: the mean size of the gradient, √2/σ against 2|e|, for residuals that are Gaussian."""
        return 2 * variance / math.sqrt(math.pi)


class FullCovariance(DataTerm):
    """A Gaussian with a 2 × 2 covariance per landmark in place of Eq. 6's two variances."""

    learns_sigma = True
    needs_correlation = True

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Without the constant; see `likelihoods.full_gaussian`."""
        if correlation is None:
            raise ValueError(
                "FullCovariance needs the correlation of each landmark's coordinates, and none was "
                "predicted. Give the regressor one (model.correlated=true), or use data_term=nll."
            )
        beyond = 1 - SAFE_CORRELATION
        # Half of what is left up to one, so that the bound itself is no singularity.
        limit = SAFE_CORRELATION + beyond / 2
        correlation = soft_clamp(correlation, -limit, limit, margin=beyond / 2)
        return likelihoods.full_gaussian(residual, log_sigma, correlation)
