"""The knowledge-encoded prior: every source of knowledge, weighted and added (Sec. 3.2, Eq. 5)."""

from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from hand_recon.knowledge.adversarial import Adversary
from hand_recon.knowledge.biomechanics import pose_loss
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.pose_components import PoseComponents
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.schema import HandPrediction


class Prior(nn.Module):
    """λ₁ L_pose + λ₂ L_non-penetration + λ₃ L_shape over a batch of predictions.

    A weight of zero switches a term off. Weights balance a data term that is summed over landmarks in
    pixels of a 224-pixel crop (`docs/decisions.md`).

    Args:
        ranges: Ranges of motion of the hand at hand.
        hand: The hand, for its surface.
        range_of_motion: λ₁, per squared radian.
        twist: Whether Eq. 1 holds for twist too. Priors that see joint positions alone cannot have it.
        functional_anatomy: Whether Eq. 2–3 refine the ranges …
        anatomy: … and by which of their rules.
        non_penetration: λ₂, per metre.
        tolerance: d_tol of Eq. 4, metres.
        geodesic: Vertices nearer than this along the surface are neighbours (Eq. 4), metres.
        shape: λ₃, per standard deviation.
        pose_components: Weight of the squared distance to the mean pose in the space of a PCA of poses: a
            peer's prior that needs 3D data, to compare with.
        adversarial: Weight of what a discriminator says that is trained on 3D data: the prior that
            Table 3 (a) compares with …
        adversary: … and that discriminator.
    """

    lower: Tensor
    upper: Tensor

    def __init__(
        self,
        ranges: RangeOfMotion,
        hand: HandModel,
        *,
        range_of_motion: float = 20_000.0,
        twist: bool = True,
        functional_anatomy: bool = False,
        anatomy: FunctionalAnatomy | None = None,
        non_penetration: float = 0.0,
        tolerance: float = 0.006,
        geodesic: float = 0.02,
        shape: float = 10.0,
        pose_components: float = 0.0,
        adversarial: float = 0.0,
        adversary: Adversary | None = None,
    ) -> None:
        super().__init__()
        self.register_buffer("lower", ranges.lower.clone(), persistent=False)
        self.register_buffer("upper", ranges.upper.clone(), persistent=False)
        if not twist:
            self.lower[:, AXES.index("twist")] = -float("inf")
            self.upper[:, AXES.index("twist")] = float("inf")
        self.anatomy = (anatomy or FunctionalAnatomy()) if functional_anatomy else None
        self.surface = (
            NonPenetration(hand, geodesic=geodesic, tolerance=tolerance)
            if non_penetration
            else None
        )
        self.components = PoseComponents() if pose_components else None
        self.adversary = (adversary or Adversary()) if adversarial else None
        self.weights = {
            "range_of_motion": range_of_motion,
            "non_penetration": non_penetration,
            "shape": shape,
            "pose_components": pose_components,
            "adversarial": adversarial,
        }

    @property
    def ranges(self) -> RangeOfMotion:
        """The ranges of Eq. 1, before any refinement."""
        return RangeOfMotion(self.lower, self.upper)

    def forward(
        self, prediction: HandPrediction, *, contact: bool = True
    ) -> dict[str, Float[Tensor, "*batch"]]:
        """The unweighted value of every term that has a weight, one per hand, by name.

        Args:
            prediction: The hands.
            contact: Whether to look at their surfaces; a fit does so only once poses mean something.
        """
        parameters = prediction.parameters
        terms = {}
        if self.weights["range_of_motion"]:
            ranges = self.ranges
            if self.anatomy is not None:
                ranges = self.anatomy.refine(ranges, parameters.joint_angles)
            terms["range_of_motion"] = pose_loss(parameters.joint_angles, ranges)
        if self.surface is not None and contact:
            terms["non_penetration"] = self.surface(prediction.vertices)
        if self.weights["shape"]:
            terms["shape"] = shape_loss(parameters.shape)
        if self.components is not None:
            terms["pose_components"] = self.components(parameters.joint_angles)
        if self.adversary is not None:
            terms["adversarial"] = self.adversary(parameters)
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
