"""Data terms, one value per hand from residuals and σ: the squared error, Eq. 7 and variants (Sec. 3.3).

A term is a sum over 42 coordinates in pixels of a 224-pixel crop, because the paper's weights of the prior
are relative to that (decision 7).
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
"""Largest |log σ| that is left unchanged; the exponential of much more would overflow single precision."""

SAFE_CORRELATION: Final = 0.995
"""Largest |correlation| that is left unchanged; at ±1 a covariance has no inverse."""

NEUTRAL_SIGMA: Final = math.sqrt(0.5)
"""σ for which 1 / (2σ²) is one, pixels."""


class DataTerm(nn.Module, ABC):
    """Base class of data terms, with or without stages."""

    needs_correlation: bool = False
    """True if a correlation of each landmark's two coordinates must be predicted."""
    learns_sigma: bool = False
    """True if σ is trained, so that it can be scored at the end of a run."""
    stages: int = 1
    """Number of losses that follow each other during a run."""

    @property
    def stage(self) -> int:
        """Index of the current loss, from 0."""
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
        # Masked before any arithmetic, because a gradient of NaN stays NaN even times zero.
        residual = residual.masked_fill(~labelled[..., None], 0.0)
        log_sigma = soft_clamp(log_sigma, -SAFE_LOG_SIGMA - 1, SAFE_LOG_SIGMA + 1, margin=1.0)
        # Masked again after it, so that the likelihood does not shrink log σ of landmarks without label.
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
        """Cost of each landmark, both coordinates together; all inputs are finite.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; zero where unlabelled.
            log_sigma: Logarithm of the standard deviation of each coordinate.
            correlation: Correlation of each landmark's two coordinates, −1 to 1, where one is predicted.
        """

    def begin(self, *, step: int, epoch: int, total_steps: int) -> bool:
        """Change the loss if its time has come; called before every training step.

        Args:
            step: Optimizer steps that the run has made.
            epoch: Epochs that it has finished.
            total_steps: Optimizer steps that it will have made at its end.

        Returns:
            True if this call changed the loss.
        """
        return False

    def observe(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
    ) -> None:
        """Record the residuals of a training step, for losses that depend on their size.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; anything where unlabelled.
            labelled: Landmarks that have a label.
        """

    def running_log_sigma(self) -> Float[Tensor, "landmark=21 2"]:
        """Logarithm of the running root mean square of each coordinate's residual, pixels.

        Raises:
            RuntimeError: The term has one stage and records no residuals.
        """
        raise RuntimeError(
            f"{type(self).__name__} has a single stage and keeps no running residual. Ask only when "
            "begin() has returned true, or use Staged."
        )

    def start(self, log_sigma: Float[Tensor, "landmark=21 2"]) -> None:
        """Called when the stage begins, with the log RMS residuals, pixels."""

    def balance(self, variance: float) -> float:
        """Factor that gives this term's gradient the size of the squared error's.

        Args:
            variance: Mean square of the residuals, square pixels; σ² is assumed to equal it.
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
        """Square pixels; σ is not used."""
        return residual.square().sum(dim=-1)


class RescaledSquaredError(DataTerm):
    """The squared error times 1 / (2σ̄²), with one σ̄ for all coordinates.

    Eq. 7 weighs landmarks by their σ and also reduces the data term against the prior. This term does only
    the latter, so that an ablation can separate the two effects.

    Args:
        sigma: σ̄, pixels of a 224-pixel crop; the default rescales nothing. As the second stage of `Staged`,
            it is replaced by the RMS of the residuals at the switch.

    Raises:
        ValueError: σ̄ is not positive.
    """

    sigma: Tensor

    def __init__(self, sigma: float = NEUTRAL_SIGMA) -> None:
        super().__init__()
        if not sigma > 0:
            raise ValueError(f"A standard deviation must be positive, found sigma={sigma} pixels.")
        self.register_buffer("sigma", torch.tensor(sigma))

    def cost(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        correlation: Float[Tensor, "*batch landmark=21"] | None,
    ) -> Float[Tensor, "*batch landmark=21"]:
        """Half the squared residual in units of σ̄; the predicted σ is not used."""
        return residual.square().sum(dim=-1) / (2 * self.sigma.square())

    def start(self, log_sigma: Float[Tensor, "landmark=21 2"]) -> None:
        """Set σ̄ to the RMS over all coordinates, where Eq. 7 with a single σ has its minimum."""
        self.sigma.copy_(torch.exp(2 * log_sigma).mean().sqrt())


class NegativeLogLikelihood(DataTerm):
    """Eq. 7, or β-NLL, which trains badly predicted landmarks faster (Seitzer et al., ICLR 2022).

    Args:
        beta: 0 for Eq. 7; 1 for the gradient of half the squared error on the means.

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
        """2σ^(2−2β), since the gradient is e σ^(2β) / σ² and the squared error's is 2e."""
        return float(2 * variance ** (1 - self.beta))


class LaplaceLikelihood(DataTerm):
    """A Laplace distribution in place of Eq. 6's Gaussian, which bounds the gradient of wrong labels."""

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
        """2σ²/√π: ratio of the mean gradient sizes, 2|e| and √2/σ, for Gaussian residuals."""
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
        # The bound is halfway between the safe correlation and one, where the inverse does not exist.
        limit = SAFE_CORRELATION + beyond / 2
        correlation = soft_clamp(correlation, -limit, limit, margin=beyond / 2)
        return likelihoods.full_gaussian(residual, log_sigma, correlation)
