"""The terms of the prior: range of motion, non-penetration and shape (Sec. 3.2, Eq. 1-5).

A term is a loss per hand with its weight; `Prior` adds terms by name. A term of your own derives from `Term`,
and a configuration names it as `+prior.<name>._target_=<your class>`.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, Final

from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.penetration.fixed_size import FixedSizeNonPenetration
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from hand_recon.schema import HandParameters

SIZES: Final = ("auto", "by_pose", "fixed")
"""Lengths of non-penetration's lists: `auto` is `fixed` on a CUDA GPU and `by_pose` elsewhere."""


class Term(nn.Module, ABC):
    """One loss of the prior, with its weight.

    Args:
        hand: The hand model. Every term is constructed with it, so that configurations look alike.
        weight: Factor of the loss in Eq. 5; zero switches the term off.
    """

    needs_vertices: ClassVar[bool] = False
    """True if the loss is a function of the posed surface."""

    def __init__(self, hand: HandModel, *, weight: float) -> None:
        super().__init__()
        self.weight = weight

    @abstractmethod
    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """The unweighted loss of each hand.

        Args:
            parameters: Pose and shape.
            vertices: The posed surface, metres; given to every term that sets `needs_vertices`.
        """


class RangeOfMotionTerm(Term):
    """L_pose: squared violation of the ranges of motion (Eq. 1), which Eq. 2–3 may refine.

    Args:
        hand: The hand model, from whose rest pose some tables count.
        weight: λ₁, per squared radian (Sec. 4.1).
        ranges: The ranges, or what `load_ranges` takes: the name or path of a table.
        twist: Whether the ranges hold for twist too. Priors that see joint positions alone cannot have it.
        anatomy: Rules that refine the ranges (Eq. 2–3); none for the table as it is.
    """

    lower: Tensor
    upper: Tensor

    def __init__(
        self,
        hand: HandModel,
        *,
        weight: float = 20_000.0,
        ranges: RangeOfMotion | str = "literature",
        twist: bool = True,
        anatomy: FunctionalAnatomy | None = None,
    ) -> None:
        super().__init__(hand, weight=weight)
        table = load_ranges(ranges, hand.rest_angles) if isinstance(ranges, str) else ranges
        self.register_buffer("lower", table.lower.clone(), persistent=False)
        self.register_buffer("upper", table.upper.clone(), persistent=False)
        if not twist:
            self.lower[:, AXES.index("twist")] = -float("inf")
            self.upper[:, AXES.index("twist")] = float("inf")
        self.anatomy = anatomy

    @property
    def ranges(self) -> RangeOfMotion:
        """The ranges of Eq. 1, before any refinement."""
        return RangeOfMotion(self.lower, self.upper)

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """Squared radians."""
        ranges = self.ranges
        if self.anatomy is not None:
            ranges = self.anatomy.refine(ranges, parameters.joint_angles)
        return range_of_motion_loss(parameters.joint_angles, ranges)


class NonPenetrationTerm(Term):
    """L_non-penetration: how deep parts of the hand are inside each other (Eq. 4).

    Args:
        hand: The hand model, for its surface.
        weight: λ₂, per metre (Sec. 4.1).
        tolerance: d_tol, metres.
        geodesic: Vertices nearer than this along the surface are neighbours, metres.
        sizes: One of `SIZES`: lists as long as the poses ask for, which is fastest on a processor, or of a
            fixed length, for which no GPU is waited for (decision 99). The value is the same.

    Raises:
        ValueError: `sizes` is unknown.
    """

    needs_vertices = True

    def __init__(
        self,
        hand: HandModel,
        *,
        weight: float = 20_000.0,
        tolerance: float = 0.006,
        geodesic: float = 0.02,
        sizes: str = "auto",
    ) -> None:
        super().__init__(hand, weight=weight)
        if sizes not in SIZES:
            raise ValueError(f"Found sizes={sizes!r}; expected one of {', '.join(SIZES)}.")
        self.non_penetration: NonPenetration
        if sizes == "by_pose":
            self.non_penetration = NonPenetration(hand, geodesic=geodesic, tolerance=tolerance)
            return
        self.non_penetration = FixedSizeNonPenetration(
            hand, geodesic=geodesic, tolerance=tolerance, everywhere=sizes == "fixed"
        )

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """Metres.

        Raises:
            ValueError: There are no vertices.
        """
        if vertices is None:
            raise ValueError(
                "Non-penetration needs the vertices of the posed hand, found none. Pass them, for example "
                "hand.to_camera(parameters).vertices."
            )
        return self.non_penetration(vertices)


class ShapeTerm(Term):
    """L_shape: the norm of the shape coefficients.

    Args:
        hand: The hand model.
        weight: λ₃, per standard deviation (Sec. 4.1).
    """

    def __init__(self, hand: HandModel, *, weight: float = 10.0) -> None:
        super().__init__(hand, weight=weight)

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """Standard deviations."""
        return shape_loss(parameters.shape)


def shape_loss(shape: Float[Tensor, "*batch direction=10"]) -> Float[Tensor, "*batch"]:
    """‖β‖₂ (Sec. 3.2), with a zero gradient at the mean shape.

    Args:
        shape: Coefficients of the shape directions, standard deviations.
    """
    # The norm has no derivative at zero; a floor of 1e-6 σ changes no value that anyone could measure.
    return shape.square().sum(dim=-1).clamp(min=1e-12).sqrt()
