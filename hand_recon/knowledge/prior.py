"""The knowledge-encoded prior: every source of knowledge, weighted and added (Sec. 3.2, Eq. 5)."""

from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.knowledge.biomechanics import pose_loss
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.schema import HandPrediction


class Prior(nn.Module):
    """λ₁ L_pose + λ₂ L_non-penetration + λ₃ L_shape over a batch of predictions.

    A weight of zero switches a term off. Weights balance a data term that is summed over landmarks in
    pixels of a 224-pixel crop (`docs/decisions.md`).

    Args:
        ranges: Ranges of motion of the hand at hand.
        range_of_motion: λ₁, per squared radian.
        functional_anatomy: Whether Eq. 2–3 refine the ranges.
        non_penetration: λ₂, per metre.
        shape: λ₃, per standard deviation.

    Raises:
        NotImplementedError: A source of knowledge is asked for that this version lacks.
    """

    lower: Tensor
    upper: Tensor

    def __init__(
        self,
        ranges: RangeOfMotion,
        *,
        range_of_motion: float = 20_000.0,
        functional_anatomy: bool = False,
        non_penetration: float = 0.0,
        shape: float = 10.0,
    ) -> None:
        super().__init__()
        for wanted, what in (
            (functional_anatomy, "functional anatomy (Eq. 2-3)"),
            (non_penetration, "the non-penetration loss (Eq. 4)"),
        ):
            if wanted:
                raise NotImplementedError(
                    f"This version of hand_recon does not have {what} yet. "
                    "Run with prior=none or prior=biomechanics (rows 1 and 2 of Table 1)."
                )
        self.register_buffer("lower", ranges.lower, persistent=False)
        self.register_buffer("upper", ranges.upper, persistent=False)
        self.weights = {"range_of_motion": range_of_motion, "shape": shape}

    def forward(self, prediction: HandPrediction) -> dict[str, Float[Tensor, " batch"]]:
        """The unweighted value of every term that has a weight, one per hand, by name."""
        parameters = prediction.parameters
        terms = {}
        if self.weights["range_of_motion"]:
            ranges = RangeOfMotion(self.lower, self.upper)
            terms["range_of_motion"] = pose_loss(parameters.joint_angles, ranges)
        if self.weights["shape"]:
            terms["shape"] = shape_loss(parameters.shape)
        return terms

    def weighted(self, terms: dict[str, Tensor]) -> dict[str, Tensor]:
        """Each term times its weight."""
        return {name: self.weights[name] * value for name, value in terms.items()}


def shape_loss(shape: Float[Tensor, "*batch direction=10"]) -> Float[Tensor, "*batch"]:
    """‖β‖₂ (Sec. 3.2), with a zero gradient at the mean shape.

    Args:
        shape: Coefficients of the shape directions, standard deviations.
    """
    # The norm has no derivative at zero; a floor of 1e-6 σ changes no value that anyone could measure.
    return shape.square().sum(dim=-1).clamp(min=1e-12).sqrt()
