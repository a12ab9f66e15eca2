"""Hand model fitted to 3D landmarks with as little knowledge as it needs to be determined (decision 81).

The loss is ½ Σ |landmark − given|² / σ² plus Gaussians on shape and pose that are far wider than living
hands vary, except for twist: twist moves no landmark of its own bone, and only small values are tried. Ranges
of motion, functional anatomy and non-penetration have no part in it, so that the fit can violate them. The
position of the hand is eliminated, since the best one for given rotations is the mean of the residuals.
"""

import math
from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.second_order.least_squares import Model
from hand_recon.fitting.second_order.levenberg_marquardt import Limits, Reached, minimize
from hand_recon.fitting.second_order.prior_terms import PriorTerms
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import COUNT, SHAPE, Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED
from hand_recon.knowledge.pose_distance import PoseDistance, PoseDistanceTerm
from hand_recon.knowledge.prior import Prior
from hand_recon.plausibility.point_start import start_of_points
from hand_recon.schema import HandParameters

SIGMA: Final = 0.002
"""Standard deviation of a given landmark's coordinate in the loss, metres."""

MEAN_BEND: Final = 25.0
"""Mean bend of the pose prior, degrees."""

SPREADS: Final = (60.0, 30.0, 5.0)
"""Standard deviations of bend, splay and twist in the pose prior, degrees."""

HINGE_SPLAY: Final = 20.0
"""Standard deviation of the splay of hinges (PIP, DIP, the thumb's MCP and IP), degrees. A hinge has no
splay; hands of other shapes than the model's, and noise, need some to meet given points."""

SHAPE_PRECISION: Final = 1e6
"""Inverse variance of the shape of hands of known shape."""

STEPS: Final = Limits(iterations=40, tolerance=1e-5)

_AT_ONCE: Final = 512


@dataclass(frozen=True)
class PointProblem:
    """Distance of a hand's landmarks from given points, with terms on pose and shape."""

    projection: LandmarkProjection
    """Landmarks of the hand model with their derivatives."""
    terms: PriorTerms
    """Terms on pose and shape."""
    target: Float[Tensor, "hand landmark=21 3"]
    """Points, metres; zero where there is none."""
    given: Bool[Tensor, "hand landmark=21"]
    """Mask of the points that are there."""
    sigma: float = SIGMA
    """Standard deviation of a coordinate, metres."""
    shape_mean: Float[Tensor, "hand direction=10"] | None = None
    """Shape that hands are kept at; None for any shape about the mean hand's."""

    @classmethod
    def of(
        cls,
        projection: LandmarkProjection,
        prior: Prior,
        points: Float[Tensor, "hand landmark=21 3"],
        sigma: float = SIGMA,
    ) -> Self:
        """The problem of some hands.

        Args:
            projection: Landmarks of the hand model, by all unknowns.
            prior: Terms on pose and shape; non-penetration is left out.
            points: Landmarks of right hands, metres; NaN where missing.
            sigma: Standard deviation of a coordinate, metres.
        """
        given = points.isfinite().all(dim=-1)
        target = points.masked_fill(~given[..., None], 0.0)
        return cls(projection, PriorTerms(prior), target, given, sigma)

    def __getitem__(self, hands: Tensor) -> Self:
        """The problem of some of the hands."""
        mean = None if self.shape_mean is None else self.shape_mean[hands]
        return replace(self, target=self.target[hands], given=self.given[hands], shape_mean=mean)

    def with_shape(self, shape: Float[Tensor, "hand direction=10"]) -> Self:
        """The same problem for hands of known shape.

        Args:
            shape: Shape coefficients, standard deviations.
        """
        return replace(self, shape_mean=shape)

    def __call__(self, unknowns: Unknowns) -> Model:
        """Compute the loss with its first and second derivatives.

        Args:
            unknowns: The hands.
        """
        eye = torch.eye(3).to(self.target).expand(len(unknowns), 3, 3)
        at = self.projection(unknowns, eye, eye)
        weight = self.given.to(self.target)[:, None]
        residual = self._centred(at.points.permute(2, 0, 1) - self.target.mT, weight)
        jacobian = self.projection.point_jacobian(at).unflatten(1, (3, -1))
        jacobian = self._centred(jacobian, weight[..., None]).flatten(1, 2) / self.sigma
        residual = residual.flatten(1) / self.sigma
        smooth, hinge = self.terms.smooth(unknowns), self.terms.hinge(unknowns)
        gradient = (jacobian.mT @ residual[..., None])[..., 0] + smooth.gradient
        shape, precision = self._shape(unknowns)
        gradient[:, SHAPE] += precision * shape
        curvature = jacobian.mT @ jacobian
        diagonal = curvature.diagonal(dim1=1, dim2=2)
        diagonal.add_(smooth.diagonal)
        diagonal[:, SHAPE] += precision
        if smooth.matrix is not None:
            curvature = curvature + smooth.matrix
        value = 0.5 * (residual.square().sum(dim=1) + precision * shape.square().sum(dim=1))
        value = value + smooth.value
        if hinge is not None:
            value = value + hinge.value()
        return Model(value, gradient, curvature, hinge, torch.arange(COUNT))

    def _shape(self, unknowns: Unknowns) -> tuple[Tensor, float]:
        """Shape from where it is kept, standard deviations, and its precision."""
        if self.shape_mean is None:
            return unknowns.shape, 1.0
        return unknowns.shape - self.shape_mean, SHAPE_PRECISION

    def offset(self, unknowns: Unknowns) -> Float[Tensor, "hand 3"]:
        """Position of the hand's origin that meets the points best, metres.

        Args:
            unknowns: The hands.
        """
        eye = torch.eye(3).to(self.target).expand(len(unknowns), 3, 3)
        points = self.projection(unknowns, eye, eye).points.permute(2, 1, 0)
        weight = self.given.to(points)[..., None]
        apart = ((self.target - points) * weight).sum(dim=1)
        return apart / weight.sum(dim=1).clamp(min=1)

    @staticmethod
    def _centred(values: Tensor, weight: Tensor) -> Tensor:
        """Values of the given landmarks minus their mean, zero for the others; landmarks are axis 2."""
        count = weight.sum(dim=2, keepdim=True).clamp(min=1)
        return (values - (values * weight).sum(dim=2, keepdim=True) / count) * weight


@dataclass(frozen=True)
class PointFit:
    """Hands that were fitted to points."""

    parameters: HandParameters
    """Right hands, in the frame of their points."""
    landmarks: Float[Tensor, "hand landmark=21 3"]
    """Landmarks of the fitted hands, metres."""
    loss: Float[Tensor, " hand"]
    """Value of the loss."""


class PointFitter:
    """Fit of one hand model to points.

    Args:
        hand: Hand model, in the landmark set of the points.
        prior: Terms on pose and shape; the wide ones of this module by default.
        sigma: Standard deviation of a coordinate, metres.
    """

    def __init__(self, hand: HandModel, prior: Prior | None = None, sigma: float = SIGMA) -> None:
        self._hand = hand
        self._light = hand.landmarks_only()
        self._projection = LandmarkProjection(hand)
        self._prior = wide_prior(hand) if prior is None else prior
        self._sigma = sigma

    @torch.no_grad()
    def __call__(
        self, points: Float[Tensor, "hand landmark=21 3"], start: HandParameters | None = None
    ) -> PointFit:
        """Fit every hand.

        Args:
            points: Landmarks of right hands, metres; NaN where missing.
            start: Hands to start from; the pose in closed form without any.
        """
        parts = []
        for rows in torch.arange(len(points)).split(_AT_ONCE):
            problem = self.problem(points[rows])
            parts.append(self._fitted(problem, self._start(points[rows], start, rows)))
        return PointFit(
            HandParameters.join([part.parameters for part in parts]),
            torch.cat([part.landmarks for part in parts]),
            torch.cat([part.loss for part in parts]),
        )

    def problem(self, points: Float[Tensor, "hand landmark=21 3"]) -> PointProblem:
        """The loss of some hands.

        Args:
            points: Landmarks of right hands, metres; NaN where missing.
        """
        return PointProblem.of(self._projection, self._prior, points, self._sigma)

    def fitted(self, problem: PointProblem, start: HandParameters) -> PointFit:
        """Fit hands to a problem that was changed.

        Args:
            problem: The loss.
            start: Hands to start from.
        """
        place = torch.zeros_like(start.translation)
        unknowns = Unknowns(start.joint_angles, start.root_rotation, place, start.shape)
        return self._fitted(problem, unknowns)

    def _start(self, points: Tensor, start: HandParameters | None, rows: Tensor) -> Unknowns:
        if start is None:
            return start_of_points(self._light, points)
        some = start.select(rows)
        place = points.new_zeros(len(points), 3)
        return Unknowns(some.joint_angles, some.root_rotation, place, some.shape)

    def _fitted(self, problem: PointProblem, start: Unknowns) -> PointFit:
        reached = minimize(problem, Reached.at(problem, start), STEPS)
        found = reached.unknowns
        # A step may take a bend past half a circle, where the same rotation has a smaller angle.
        angles = torch.remainder(found.joint_angles + math.pi, 2 * math.pi) - math.pi
        parameters = HandParameters(angles, found.shape, found.root_rotation, problem.offset(found))
        landmarks = self._light.to_camera(parameters).landmarks
        return PointFit(parameters, landmarks, reached.model.value)


def wide_prior(hand: HandModel) -> Prior:
    """Gaussians on pose and shape that determine what points leave open, and little else.

    Args:
        hand: Hand model.
    """
    deviation = torch.tensor(SPREADS).repeat(len(ARTICULATED), 1)
    hinges = [i for i, joint in enumerate(ARTICULATED) if not _is_ball(joint)]
    deviation[hinges, 1] = HINGE_SPLAY
    mean = torch.tensor([MEAN_BEND, 0.0, 0.0]).repeat(len(ARTICULATED), 1).deg2rad().flatten()
    covariance = deviation.deg2rad().flatten().square().diag()
    distance = PoseDistance.of_gaussian(mean.to(hand.template), covariance.to(hand.template))
    return Prior({"pose": PoseDistanceTerm(hand, weight=0.5, distance=distance)})


def _is_ball(joint: str) -> bool:
    """True for joints that splay: the fingers' MCPs and the thumb's CMC."""
    return joint.endswith("CMC") or (joint.endswith("MCP") and not joint.startswith("thumb"))
