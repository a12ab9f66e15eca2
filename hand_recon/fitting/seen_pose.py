"""The pose that a network sees in pixels, as a term of a fit to landmarks (decision 76)."""

import math
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.fitting.observation import Observation
from hand_recon.knowledge.natural_pose import natural_poses
from hand_recon.knowledge.pose_distance import PoseDistance

AGREES: Final = 20.0
"""Largest mean distance of the landmarks that a network finds from the given ones with which its pose is
believed, pixels of a 224-pixel crop."""

Angles = Float[Tensor, "hand angle=45"]


@dataclass(frozen=True)
class SeenModel:
    """The term at some hands with its derivatives, by the joint angles or by a fit's unknowns."""

    value: Float[Tensor, " hand"]
    """Weighted loss."""
    gradient: Float[Tensor, "hand unknown"]
    """First derivatives."""
    curvature: Float[Tensor, "hand unknown unknown"]
    """Second derivatives; zero for hands that no network saw."""


@dataclass(frozen=True)
class SeenPoseTerm:
    """Squared distance of a pose from the one that a network sees, in standard deviations of natural poses.

    Landmarks leave open how far fingers point to the camera or away from it; pixels say more about that.
    Hands that no network saw have a loss of zero.
    """

    weight: float
    """Factor of the squared distance."""
    distance: PoseDistance
    """Distance in standard deviations of natural poses; its mean does not count."""

    @classmethod
    def of(cls, weight: float) -> Self:
        """The distance by the covariance of natural poses.

        Args:
            weight: Factor of the squared distance; ½ makes it the negative logarithm of a Gaussian.

        Raises:
            ValueError: The weight is negative or not finite.
            FileNotFoundError: The table of natural poses is missing.
        """
        if not 0 <= weight < math.inf:
            raise ValueError(f"Found seen_pose_weight={weight}; expected a number, 0 or more.")
        return cls(weight, PoseDistance.of_gaussian(*natural_poses()))

    def value(self, joint_angles: Angles, observation: Observation) -> Float[Tensor, " hand"]:
        """Squared distance of each hand, without the weight.

        Args:
            joint_angles: Joint angles, radians.
            observation: The same hands.
        """
        return self.distance.squared(_difference(joint_angles, observation)[0])

    def expanded(self, joint_angles: Angles, observation: Observation) -> SeenModel:
        """Weighted value and derivatives by the joint angles.

        Args:
            joint_angles: Joint angles, radians.
            observation: The same hands.
        """
        difference, known = _difference(joint_angles, observation)
        found = self.distance.expanded(difference)
        return SeenModel(
            self.weight * found.value,
            self.weight * found.gradient,
            self.weight * known[:, :, None] * found.curvature,
        )


def believed(
    poses: Float[Tensor, "hand joint=15 axis=3"],
    found_2d: Float[Tensor, "hand landmark=21 2"],
    given_2d: Float[Tensor, "hand landmark=21 2"],
    crop_size: int,
) -> Float[Tensor, "hand joint=15 axis=3"]:
    """Poses that a network saw, NaN where it found the landmarks elsewhere (`AGREES`).

    Args:
        poses: Joint angles, radians.
        found_2d: Landmarks that the network found or projected, pixels of the crop.
        given_2d: Landmarks that the hands are fitted to, pixels of the crop; NaN where there is none.
        crop_size: Side of the crop, pixels.
    """
    distance = (found_2d - given_2d).norm(dim=-1) * (REFERENCE_SIZE / crop_size)
    agrees = distance.nanmean(dim=1) <= AGREES
    return torch.where(agrees[:, None, None], poses, torch.nan)


def _difference(
    joint_angles: Angles, observation: Observation
) -> tuple[Angles, Bool[Tensor, "hand 1"]]:
    """Joint angles minus those that a network saw, zero for hands that none saw; True for those seen."""
    estimate = observation.estimate
    seen = None if estimate is None else estimate.seen_pose
    if seen is None:
        seen = torch.full_like(joint_angles, torch.nan)
    seen = seen.flatten(1).to(joint_angles)
    known = seen.isfinite().all(dim=1, keepdim=True)
    return torch.where(known, joint_angles - seen, 0.0), known
