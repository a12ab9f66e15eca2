"""The pose that a network sees in pixels, as a term of a fit to landmarks (decision 76)."""

from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.observation import Observation
from hand_recon.knowledge.natural_pose import natural_poses
from hand_recon.knowledge.pose_distance import PoseDistance

Angles = Float[Tensor, "hand angle=45"]


@dataclass(frozen=True)
class SeenModel:
    """The term at the current hands with its derivatives, by the joint angles or by a fit's unknowns."""

    value: Float[Tensor, " hand"]
    """Weighted loss."""
    gradient: Float[Tensor, "hand unknown"]
    """First derivatives."""
    curvature: Float[Tensor, "hand unknown unknown"]
    """Second derivatives; zero for hands that no network saw."""


@dataclass(frozen=True)
class SeenPose:
    """Squared distance of a pose from the one that a network sees, in standard deviations of natural poses.

    Landmarks leave open how far fingers point to the camera or away from it; pixels say more about that.
    """

    weight: float
    """Factor of the squared distance."""
    whitening: Float[Tensor, "component angle=45"]
    """Matrix from differences of joint angles, radians, to standard deviations."""

    @classmethod
    def of(cls, weight: float) -> Self:
        """The distance by the covariance of natural poses.

        Args:
            weight: Factor of the squared distance; ½ makes it the negative logarithm of a Gaussian.

        Raises:
            ValueError: The weight is negative.
        """
        if not weight >= 0:
            raise ValueError(f"Found seen_pose_weight={weight}; expected 0 or more.")
        return cls(weight, PoseDistance.of_gaussian(*natural_poses()).whitening)

    def known(self, observation: Observation) -> Bool[Tensor, " hand"] | None:
        """True for hands whose pose a network saw; None if there is no such hand.

        Args:
            observation: The hands.
        """
        if observation.estimate is None or observation.estimate.seen_pose is None:
            return None
        known = observation.estimate.seen_pose.isfinite().flatten(1).all(dim=1)
        return known if bool(known.any()) else None

    def coefficients(
        self, joint_angles: Angles, observation: Observation
    ) -> Float[Tensor, "hand component"] | None:
        """Difference from the seen pose in standard deviations, zero for hands without; None without any.

        Args:
            joint_angles: Joint angles, radians.
            observation: The same hands.
        """
        known = self.known(observation)
        if known is None:
            return None
        assert observation.estimate is not None and observation.estimate.seen_pose is not None  # noqa: S101, PT018
        seen = observation.estimate.seen_pose.flatten(1).to(joint_angles)
        difference = torch.where(known[:, None], joint_angles - seen, 0.0)
        return difference @ self.whitening.to(joint_angles).mT

    def value(
        self, joint_angles: Angles, observation: Observation
    ) -> Float[Tensor, " hand"] | None:
        """Weighted loss of each hand; None if no network saw any.

        Args:
            joint_angles: Joint angles, radians.
            observation: The same hands.
        """
        coefficients = self.coefficients(joint_angles, observation)
        return None if coefficients is None else self.weight * coefficients.square().sum(dim=1)

    def expanded(self, joint_angles: Angles, observation: Observation) -> SeenModel | None:
        """Value and derivatives by the joint angles; None if no network saw any hand.

        Args:
            joint_angles: Joint angles, radians.
            observation: The same hands.
        """
        coefficients = self.coefficients(joint_angles, observation)
        known = self.known(observation)
        if coefficients is None or known is None:
            return None
        whitening = self.whitening.to(joint_angles)
        value = self.weight * coefficients.square().sum(dim=1)
        gradient = 2 * self.weight * coefficients @ whitening
        matrix = 2 * self.weight * whitening.mT @ whitening
        return SeenModel(value, gradient, known[:, None, None] * matrix)
