"""The data term: how far the projected landmarks may lie from their labels (Sec. 3.3).

This version has the squared error, the first stage of the paper's schedule. The negative
log-likelihood follows; its config group is in place and says so.
"""

from jaxtyping import Bool, Float
from torch import Tensor, nn


class SquaredError(nn.Module):
    """The sum of squared residuals over the labelled coordinates (Sec. 4.1, the first stage)."""

    def forward(
        self,
        residual: Float[Tensor, "*batch landmark=21 2"],
        log_sigma: Float[Tensor, "*batch landmark=21 2"],
        labelled: Bool[Tensor, "*batch landmark=21"],
    ) -> Float[Tensor, "*batch"]:
        """One value per hand.

        Args:
            residual: Projection minus label, pixels of a 224-pixel crop; anything where unlabelled.
            log_sigma: Predicted logarithm of the standard deviation, ignored here.
            labelled: Landmarks that have a label.
        """
        # Masked before squaring: the gradient of a square at NaN would be NaN even times zero.
        squared = residual.masked_fill(~labelled[..., None], 0.0).square()
        # A hand with half its labels counts as much as one with all, so λ's keep their meaning.
        share = labelled.sum(dim=-1).clamp(min=1) / labelled.shape[-1]
        return squared.sum(dim=(-2, -1)) / share


class NegativeLogLikelihood(nn.Module):
    """The Gaussian likelihood of Eq. 6–7, for which the config group already has a place.

    Raises:
        NotImplementedError: Always, in this version.
    """

    def __init__(self, **_: object) -> None:
        super().__init__()
        raise NotImplementedError(
            "This version of hand_recon does not have the negative log-likelihood (Eq. 6-7) yet. "
            "Run with data_term=mse (rows 1 to 4 of Table 1 use it)."
        )
