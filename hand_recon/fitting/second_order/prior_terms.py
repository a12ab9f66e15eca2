"""The prior's terms on pose and shape as functions with second derivatives (Sec. 3.2, Eq. 1–3).

The ranges of motion are a hinge, squared: its second derivative is 2λ₁ outside the ranges and zero inside.
Which angles are outside is decided anew for every step (`RangeHinge`).
"""

from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, SHAPE, Unknowns
from hand_recon.knowledge.pose_distance import PoseDistanceTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.terms import NonPenetrationTerm, RangeOfMotionTerm, ShapeTerm

SMALL_SHAPE: Final = 0.02
"""Norm of the shape around which the norm is rounded off, standard deviations; it has a kink at zero."""

NARROWEST: Final = 0.05
"""Least width of a range that an angle is centred in, radians."""

_Angles = Float[Tensor, "hand angle"]


@dataclass(frozen=True)
class RangeHinge:
    """Squared violation of the ranges of motion of each hand."""

    angles: _Angles
    """Joint angles, radians."""
    lower: _Angles
    """Lower bounds, radians."""
    upper: _Angles
    """Upper bounds, radians."""
    weight: float
    """λ₁, per squared radian."""

    def nearest(self, angles: _Angles) -> _Angles:
        """The nearest angles inside the ranges, radians.

        Args:
            angles: Joint angles, radians.
        """
        return torch.minimum(torch.maximum(angles, self.lower), self.upper)

    def value(self) -> Float[Tensor, " hand"]:
        """Weighted loss."""
        return self.weight * (self.angles - self.nearest(self.angles)).square().sum(dim=1)

    def expanded(self, expected: _Angles) -> tuple[_Angles, _Angles]:
        """Gradient at the current angles and curvature of the branch of the hinge at expected angles.

        Args:
            expected: Angles that a step is expected to reach, radians.
        """
        bound = self.nearest(expected)
        curvature = 2 * self.weight * (expected != bound).to(expected)
        # Where the branch is flat the bound may be infinite, and zero times infinity is NaN.
        beyond = torch.where(curvature > 0, self.angles - bound, 0.0)
        return curvature * beyond, curvature

    def of_angles(self, some: Tensor) -> Self:
        """The hinges of some of the angles.

        Args:
            some: Their indices.
        """
        return replace(
            self,
            angles=self.angles[:, some],
            lower=self.lower[:, some],
            upper=self.upper[:, some],
        )

    def __getitem__(self, hands: Tensor) -> Self:
        """The hinges of some of the hands."""
        return replace(
            self, angles=self.angles[hands], lower=self.lower[hands], upper=self.upper[hands]
        )

    def joined(self, other: Self) -> Self:
        """These hinges, then other ones.

        Args:
            other: Hinges of the same ranges.
        """
        return replace(
            self,
            angles=torch.cat([self.angles, other.angles]),
            lower=torch.cat([self.lower, other.lower]),
            upper=torch.cat([self.upper, other.upper]),
        )

    def put(self, hands: Tensor, some: Self) -> Self:
        """These hinges with those of some hands replaced.

        Args:
            hands: Indices of those hands.
            some: Their hinges.
        """
        return replace(
            self,
            angles=self.angles.index_put((hands,), some.angles),
            lower=self.lower.index_put((hands,), some.lower),
            upper=self.upper.index_put((hands,), some.upper),
        )

    def where(self, chosen: Tensor, other: Self) -> Self:
        """These hinges where a mask of hands is true, the others' elsewhere."""
        chosen = chosen[:, None]
        return replace(
            self,
            angles=torch.where(chosen, self.angles, other.angles),
            lower=torch.where(chosen, self.lower, other.lower),
            upper=torch.where(chosen, self.upper, other.upper),
        )


@dataclass(frozen=True)
class Smooth:
    """Second-order model of the terms without kinks."""

    value: Float[Tensor, " hand"]
    """Weighted loss."""
    gradient: Float[Tensor, "hand unknown=61"]
    """Derivatives by the unknowns."""
    diagonal: Float[Tensor, "hand unknown=61"]
    """Diagonal of a positive semi-definite approximation of the second derivatives."""
    matrix: Float[Tensor, "unknown=61 unknown=61"] | None
    """Further second derivatives, the same for all hands."""


class PriorTerms:
    """The terms of a prior that are functions of pose and shape.

    Args:
        prior: The prior.
        centred: Whether to add half the squared distance of every angle from the middle of its range, in
            standard deviations of a uniform distribution over the range. The ranges alone leave angles that
            landmarks do not determine anywhere; with it, they go to the middle. A prior with a mean pose
            does not need it.
    """

    def __init__(self, prior: Prior, *, centred: bool = False) -> None:
        terms = list(prior.terms.values())
        ranges = [term for term in terms if type(term) is RangeOfMotionTerm]
        self._range = ranges[0] if ranges else None
        self._shape_weight = sum(term.weight for term in terms if type(term) is ShapeTerm)
        self._distances = pose_distances(prior)
        self._centre: tuple[Tensor, Tensor] | None = None
        if centred and self._range is not None and not self._distances:
            self._centre = _uniform_moments(self._range)

    @property
    def bounds_pose(self) -> bool:
        """True if every angle has a loss with curvature everywhere."""
        return bool(self._distances) or self._centre is not None

    def free(self) -> Int[Tensor, " unknown"]:
        """Indices of the unknowns without the angles that the ranges fix, such as twist."""
        every = torch.arange(COUNT)
        if self._range is None:
            return every
        width = (self._range.upper - self._range.lower).flatten().cpu()
        return torch.cat([every[ANGLES][width > 0], every[ANGLES.stop :]])

    def smooth(self, unknowns: Unknowns) -> Smooth:
        """Model the terms without kinks.

        Args:
            unknowns: The hands.
        """
        shape = unknowns.shape
        norm = (shape.square().sum(dim=1) + SMALL_SHAPE**2).sqrt()
        value = self._shape_weight * norm
        gradient, diagonal = shape.new_zeros(len(shape), COUNT), shape.new_zeros(len(shape), COUNT)
        gradient[:, SHAPE] = self._shape_weight * shape / norm[:, None]
        # Larger than the norm's own second derivatives, as in reweighted least squares: no step overshoots.
        diagonal[:, SHAPE] = (self._shape_weight / norm)[:, None]
        angles = unknowns.joint_angles.flatten(1)
        if self._centre is not None:
            mean, precision = self._centre
            value = value + 0.5 * (precision * (angles - mean).square()).sum(dim=1)
            gradient[:, ANGLES] += precision * (angles - mean)
            diagonal[:, ANGLES] += precision
        matrix = None
        for term in self._distances:
            found = term.distance.expanded(angles - term.distance.mean.to(angles))
            value = value + term.weight * found.value
            gradient[:, ANGLES] += term.weight * found.gradient
            matrix = shape.new_zeros(COUNT, COUNT) if matrix is None else matrix
            matrix[ANGLES, ANGLES] += term.weight * found.curvature
        return Smooth(value, gradient, diagonal, matrix)

    def hinge(self, unknowns: Unknowns) -> RangeHinge | None:
        """Violation of the ranges, refined by functional anatomy for the current pose; none without ranges.

        Args:
            unknowns: The hands.
        """
        term = self._range
        if term is None:
            return None
        angles = unknowns.joint_angles
        ranges = term.ranges
        if term.anatomy is not None:
            ranges = term.anatomy.refine(ranges, angles)
        lower, upper = ranges.lower.expand_as(angles), ranges.upper.expand_as(angles)
        return RangeHinge(angles.flatten(1), lower.flatten(1), upper.flatten(1), term.weight)


def without_second_derivatives(prior: Prior) -> list[str]:
    """Names of the terms of a prior that a second-order fit cannot have.

    Args:
        prior: The prior.
    """
    known = (RangeOfMotionTerm, ShapeTerm, NonPenetrationTerm)
    once = (RangeOfMotionTerm, NonPenetrationTerm)
    seen: list[type] = []
    names = []
    for name, term in prior.terms.items():
        # Classes derived from the others may have another loss.
        possible = type(term) in known or term in pose_distances(prior)
        if not possible or (type(term) in once and type(term) in seen):
            names.append(name)
        seen.append(type(term))
    return names


def pose_distances(prior: Prior) -> list[PoseDistanceTerm]:
    """Terms of a prior whose loss is the squared distance from a mean pose.

    Args:
        prior: The prior.
    """
    terms = [term for term in prior.terms.values() if isinstance(term, PoseDistanceTerm)]
    # A class derived from it may have another loss.
    return [term for term in terms if type(term).forward is PoseDistanceTerm.forward]


def _uniform_moments(term: RangeOfMotionTerm) -> tuple[Tensor, Tensor]:
    """Mean and inverse variance of uniform distributions over the ranges; zero for unbounded ones."""
    lower, upper = term.lower.flatten(), term.upper.flatten()
    # Twist and other fixed angles have a range of width zero, which the hinge alone holds.
    width = (upper - lower).clamp(min=NARROWEST)
    bounded = width.isfinite()
    return torch.where(bounded, (lower + upper) / 2, 0.0), torch.where(bounded, 12 / width**2, 0.0)
