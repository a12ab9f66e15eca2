"""The loss of a fit as a least-squares problem: data term, ranges of motion and shape (Sec. 3.4)."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.data_weights import data_weights, is_quadratic
from hand_recon.fitting.second_order.prior_terms import PriorTerms, RangeHinge
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import ANGLES, COUNT, Unknowns
from hand_recon.fitting.seen_pose import SeenModel, SeenPoseTerm
from hand_recon.uncertainty import DataTerm


@dataclass(frozen=True)
class Model:
    """Second-order model of the loss at the current hands."""

    value: Float[Tensor, " hand"]
    """Loss, up to a constant of each hand."""
    gradient: Float[Tensor, "hand unknown"]
    """Derivatives of the loss without the hinge, by the free unknowns."""
    curvature: Float[Tensor, "hand unknown unknown"]
    """Gauss–Newton approximation of its second derivatives, without the hinge."""
    hinge: RangeHinge | None
    """Violation of the ranges by the free angles; its second derivatives depend on the step."""
    free: Int[Tensor, " unknown"]
    """Indices of the free unknowns among all."""

    def __getitem__(self, hands: Tensor) -> Self:
        """The models of some of the hands."""
        hinge = None if self.hinge is None else self.hinge[hands]
        return replace(
            self,
            value=self.value[hands],
            gradient=self.gradient[hands],
            curvature=self.curvature[hands],
            hinge=hinge,
        )

    def joined(self, other: Self) -> Self:
        """These models, then other ones.

        Args:
            other: Models of the same kind of problem.
        """
        hinge = self.hinge
        if hinge is not None and other.hinge is not None:
            hinge = hinge.joined(other.hinge)
        return replace(
            self,
            value=torch.cat([self.value, other.value]),
            gradient=torch.cat([self.gradient, other.gradient]),
            curvature=torch.cat([self.curvature, other.curvature]),
            hinge=hinge,
        )

    def put(self, hands: Tensor, some: Self) -> Self:
        """These models with those of some hands replaced.

        Args:
            hands: Indices of those hands.
            some: Their models.
        """
        hinge = self.hinge
        if hinge is not None and some.hinge is not None:
            hinge = hinge.put(hands, some.hinge)
        return replace(
            self,
            value=self.value.index_put((hands,), some.value),
            gradient=self.gradient.index_put((hands,), some.gradient),
            curvature=self.curvature.index_put((hands,), some.curvature),
            hinge=hinge,
        )

    def where(self, chosen: Tensor, other: Self) -> Self:
        """These models where a mask of hands is true, the others' elsewhere."""
        hinge = self.hinge
        if hinge is not None and other.hinge is not None:
            hinge = hinge.where(chosen, other.hinge)
        return replace(
            self,
            value=torch.where(chosen, self.value, other.value),
            gradient=torch.where(chosen[:, None], self.gradient, other.gradient),
            curvature=torch.where(chosen[:, None, None], self.curvature, other.curvature),
            hinge=hinge,
        )


@dataclass(frozen=True)
class Problem:
    """Loss of some hands as a function of their unknowns."""

    projection: LandmarkProjection
    """Projection of the hand model's landmarks."""
    terms: PriorTerms
    """Terms of the prior on pose and shape."""
    data_term: DataTerm
    """Data term, in the stage that is minimized."""
    observation: Observation
    """The landmarks."""
    log_sigma: Float[Tensor, "hand landmark=21 2"]
    """Logarithm of σ of each coordinate, pixels."""
    target: Float[Tensor, "hand landmark=21 2"]
    """Landmarks, pixels; zero where there is none."""
    inverse: Float[Tensor, "hand 3 3"]
    """Inverse camera matrices."""
    weights: Float[Tensor, "hand landmark=21 2"] | None
    """Second derivatives of the data term by the residuals, if they are constant."""
    seen_pose_term: SeenPoseTerm | None = None
    """Term of the pose that a network sees."""

    @classmethod
    def of(
        cls,
        projection: LandmarkProjection,
        terms: PriorTerms,
        data_term: DataTerm,
        observation: Observation,
        seen_pose_term: SeenPoseTerm | None = None,
    ) -> Self:
        """The problem of some landmarks.

        Args:
            projection: Projection of the hand model's landmarks.
            terms: Terms of the prior on pose and shape.
            data_term: Data term, in the stage that is minimized.
            observation: The landmarks.
            seen_pose_term: Term of the pose that a network sees.
        """
        labelled, log_sigma = observation.labelled, observation.log_sigma()
        target = observation.landmarks_2d.masked_fill(~labelled[..., None], 0.0)
        weights = None
        if is_quadratic(data_term):
            weights = data_weights(data_term, target, log_sigma, labelled)
        inverse = torch.linalg.inv(observation.intrinsics)
        return cls(
            projection,
            terms,
            data_term,
            observation,
            log_sigma,
            target,
            inverse,
            weights,
            seen_pose_term,
        )

    def __getitem__(self, hands: Tensor) -> Self:
        """The problem of some of the hands."""
        return replace(
            self,
            observation=self.observation[hands],
            log_sigma=self.log_sigma[hands],
            target=self.target[hands],
            inverse=self.inverse[hands],
            weights=None if self.weights is None else self.weights[hands],
        )

    def __call__(self, unknowns: Unknowns) -> Model:
        """Compute the loss with its first and second derivatives.

        Args:
            unknowns: The hands.
        """
        at = self.projection(unknowns, self.observation.intrinsics, self.inverse)
        residual = at.pixels.permute(2, 1, 0) - self.target
        data, weights = self._data(residual)
        jacobian = self.projection.jacobian(at, self.inverse)
        weighted = jacobian * weights.mT.flatten(1)[..., None]
        smooth, hinge = self.terms.smooth(unknowns), self.terms.hinge(unknowns)
        free = self.projection.free
        gradient = (weighted.mT @ residual.mT.flatten(1)[..., None])[..., 0]
        gradient = gradient + smooth.gradient[:, free]
        curvature = jacobian.mT @ weighted
        curvature.diagonal(dim1=1, dim2=2).add_(smooth.diagonal[:, free])
        if smooth.matrix is not None:
            curvature = curvature + smooth.matrix[free][:, free]
        value = data + smooth.value
        seen = self.seen(unknowns)
        if seen is not None:
            value = value + seen.value
            gradient = gradient + seen.gradient
            curvature = curvature + seen.curvature
        if hinge is not None:
            value = value + hinge.value()
            hinge = hinge.of_angles(self._free_angles)
        return Model(value, gradient, curvature, hinge, free)

    def seen(self, unknowns: Unknowns) -> SeenModel | None:
        """Model of the term of the pose that a network sees, by the free unknowns; None without a network.

        Args:
            unknowns: The hands.
        """
        if self.seen_pose_term is None:
            return None
        found = self.seen_pose_term.expanded(unknowns.joint_angles.flatten(1), self.observation)
        angles = self._free_angles
        rest = len(self.projection.free) - len(angles)
        gradient, curvature = found.gradient[:, angles], found.curvature[:, angles][:, :, angles]
        return SeenModel(found.value, pad(gradient, (0, rest)), pad(curvature, (0, rest, 0, rest)))

    @property
    def _free_angles(self) -> Int[Tensor, " angle"]:
        """Indices of the free angles, which are the first of the free unknowns."""
        free = self.projection.free
        return free[: len(free) - COUNT + ANGLES.stop]

    def _data(self, residual: Tensor) -> tuple[Tensor, Tensor]:
        """Data term of each hand, and the weights of the squared residuals."""
        if self.weights is not None:
            return 0.5 * (self.weights * residual.square()).sum(dim=(1, 2)), self.weights
        labelled = self.observation.labelled
        value = self.data_term(residual, self.log_sigma, labelled)
        return value, data_weights(self.data_term, residual, self.log_sigma, labelled)
