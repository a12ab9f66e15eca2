"""Distance of a pose from a mean pose in standard deviations, as a term of a prior."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.terms import Term
from hand_recon.schema import HandParameters


class PoseDistance(nn.Module):
    """Squared Mahalanobis distance of a pose from a mean pose.

    Args:
        mean: Mean of the joint angles, radians.
        whitening: Matrix that maps joint angles minus the mean to standard deviations.
    """

    mean: Tensor
    whitening: Tensor

    def __init__(
        self,
        mean: Float[Tensor, " angle=45"],
        whitening: Float[Tensor, "component angle=45"],
    ) -> None:
        super().__init__()
        self.register_buffer("mean", mean, persistent=False)
        self.register_buffer("whitening", whitening, persistent=False)

    @classmethod
    def of_gaussian(
        cls, mean: Float[Tensor, " angle=45"], covariance: Float[Tensor, "angle=45 angle=45"]
    ) -> "PoseDistance":
        """The distance in the standard deviations of a Gaussian.

        Args:
            mean: Its mean, radians.
            covariance: Its covariance, squared radians, positive definite.
        """
        # With L Lᵀ = covariance, L⁻¹ maps angles to standard deviations.
        factor = torch.linalg.cholesky(covariance.double())
        eye = torch.eye(len(factor), dtype=factor.dtype)
        whitening = torch.linalg.solve_triangular(factor, eye, upper=False)
        return PoseDistance(mean, whitening.to(mean))

    def forward(
        self, joint_angles: Float[Tensor, "*batch joint=15 axis=3"]
    ) -> Float[Tensor, "*batch"]:
        """One value per hand: the sum of squared coefficients, each in standard deviations.

        Args:
            joint_angles: Bend, splay and twist, radians.
        """
        return self.squared(joint_angles.flatten(-2) - self.mean.to(joint_angles))

    def squared(self, from_mean: Float[Tensor, "*batch angle=45"]) -> Float[Tensor, "*batch"]:
        """The squared distance.

        Args:
            from_mean: Joint angles minus the mean, or minus another pose, radians.
        """
        return (from_mean @ self.whitening.to(from_mean).mT).square().sum(dim=-1)

    def expanded(self, from_mean: Float[Tensor, "*batch angle=45"]) -> "Quadratic":
        """The squared distance with its derivatives.

        Args:
            from_mean: Joint angles minus the mean, or minus another pose, radians.
        """
        whitening = self.whitening.to(from_mean)
        coefficients = from_mean @ whitening.mT
        return Quadratic(
            coefficients.square().sum(dim=-1),
            2 * coefficients @ whitening,
            2 * whitening.mT @ whitening,
        )


@dataclass(frozen=True)
class Quadratic:
    """A squared distance with its derivatives by the joint angles."""

    value: Float[Tensor, "*batch"]
    """Squared standard deviations."""
    gradient: Float[Tensor, "*batch angle=45"]
    """First derivatives."""
    curvature: Float[Tensor, "angle=45 angle=45"]
    """Second derivatives, the same for every pose."""


class PoseDistanceTerm(Term):
    """The squared distance from a mean pose, with its weight.

    Args:
        hand: The hand model.
        weight: Factor of the squared distance; ½ makes it the negative logarithm of a Gaussian.
        distance: The distance.
    """

    def __init__(self, hand: HandModel, *, weight: float, distance: PoseDistance) -> None:
        super().__init__(hand, weight=weight)
        self.distance = distance

    def forward(
        self, parameters: HandParameters, vertices: Float[Tensor, "*batch vertex 3"] | None
    ) -> Float[Tensor, "*batch"]:
        """Squared standard deviations."""
        return self.distance(parameters.joint_angles)
