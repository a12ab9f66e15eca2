"""Covariance of each 3D landmark: a mixture of Gaussians about the minima that a fit has found (Sec. 3.3).

With a likelihood as data term, the loss is the negative logarithm of a posterior density up to a constant.
Each minimum has the Gaussian of its second derivatives (Laplace's approximation), weighted by its height and
its volume. The covariance of the mixture has two parts: that within a minimum, and the distances between
minima, such as the two depths of a finger that look alike. `hand_recon.uncertainty.covariance_correction`
corrects it.
"""

from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.second_order.laplace import factor_of, log_volume_of
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Reached

ALIKE: Final = 0.004
"""Largest distance of a landmark between two results that are the same minimum, metres."""


@dataclass(frozen=True)
class Minimum:
    """A result of the fit of each hand with the Gaussian about it."""

    points: Float[Tensor, "hand landmark=21 3"]
    """Landmarks from the hand's origin, axes of the camera, metres."""
    covariance: Float[Tensor, "hand landmark=21 3 3"]
    """Covariance of each landmark, square metres."""
    log_mass: Float[Tensor, " hand"]
    """Logarithm of the probability of the minimum, up to a constant of each hand."""

    @classmethod
    def of(cls, problem: Problem, reached: Reached) -> Self:
        """The Gaussians about the results of some steps.

        Args:
            problem: The loss, with a prior that bounds every unknown.
            reached: The results, one per hand of the problem.
        """
        projection = problem.projection
        at = projection(reached.unknowns, problem.observation.intrinsics, problem.inverse)
        slope = projection.point_jacobian(at).double()
        factor = factor_of(reached.model)
        # With L Lᵀ the curvature and J the derivatives: J (L Lᵀ)⁻¹ Jᵀ = (L⁻¹ Jᵀ)ᵀ (L⁻¹ Jᵀ).
        whitened = torch.linalg.solve_triangular(factor, slope.mT, upper=False)
        by_landmark = whitened.unflatten(2, (3, -1)).permute(0, 3, 2, 1)
        covariance = by_landmark @ by_landmark.mT
        value = reached.model.value.double()
        mass = log_volume_of(factor) - value
        points = at.points.permute(2, 1, 0)
        return cls(points, covariance.to(points), mass.to(points))

    def select(self, kept: Tensor) -> Self:
        """The minima of some of the hands."""
        return type(self)(self.points[kept], self.covariance[kept], self.log_mass[kept])


def mixed_covariance(
    best: Minimum, others: Minimum, count: int
) -> Float[Tensor, "hand landmark=21 3 3"]:
    """Covariance of each landmark about the best result, over all minima.

    Args:
        best: The result of each hand.
        others: Further results, `count` of each hand behind each other.
        count: Number of further results per hand.
    """
    hands = len(best.points)
    points = torch.cat([best.points[:, None], others.points.view(hands, count, 21, 3)], dim=1)
    within = torch.cat(
        [best.covariance[:, None], others.covariance.view(hands, count, 21, 3, 3)], dim=1
    )
    mass = torch.cat([best.log_mass[:, None], others.log_mass.view(hands, count)], dim=1)
    mass = mass.masked_fill(repeated(points, mass), -torch.inf)
    weight = torch.softmax(mass.nan_to_num(-torch.inf), dim=1)[..., None, None, None]
    away = (points - best.points[:, None])[..., None]
    return (weight * (within + away @ away.mT)).sum(dim=1)


def repeated(
    points: Float[Tensor, "hand result landmark=21 3"],
    mass: Float[Tensor, "hand result"],
    near: float = ALIKE,
) -> Bool[Tensor, "hand result"]:
    """Mask of the results that are the same minimum as an earlier one; the best one is the first.

    Args:
        points: Landmarks of each result, metres.
        mass: Number of each result that is finite if its loss is.
        near: Largest distance of a landmark within which two results are the same, metres.
    """
    count = points.shape[1]
    apart = (points[:, :, None] - points[:, None]).norm(dim=-1).amax(dim=-1)
    earlier = torch.ones(count, count, dtype=torch.bool).tril(diagonal=-1)
    # A result without a finite loss hides no other.
    return ((apart < near) & earlier & mass.isfinite()[:, None]).any(dim=2)
