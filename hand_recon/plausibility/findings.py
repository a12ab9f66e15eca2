"""Measured implausibility of posed hands: ranges, functional anatomy, penetration, bones (Sec. 3.2)."""

from dataclasses import dataclass, field
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.skeleton import AXES, LANDMARK_PARENTS, LANDMARKS
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.plausibility.posed_hands import HandModels, PosedHands

Angles = Float[Tensor, "hand joint=15 axis=3"]

PHALANGES: Final = tuple(
    index for index, name in enumerate(LANDMARKS) if name.split()[-1] in ("PIP", "DIP", "tip", "IP")
)
"""Landmarks at the outer ends of the fingers' bones, without the palm's, which sources place differently."""

ROUNDING: Final = 2e-3
"""Violation that rounding in files and in single precision explains, degrees."""

_AT_ONCE: Final = 256


@dataclass(frozen=True)
class Knowledge:
    """Knowledge that hands are audited against."""

    ranges: RangeOfMotion
    """Table of ranges of motion, radians."""
    anatomy: FunctionalAnatomy = field(default_factory=FunctionalAnatomy)
    """Rules that narrow the ranges."""
    tolerance: float = 0.006
    """Depth of penetration that soft tissue allows, metres."""


@dataclass(frozen=True)
class Findings:
    """Measurements of every hand; NaN where there is none."""

    angles: Angles
    """Joint angles, degrees."""
    beyond_range: Angles
    """Degrees above the upper bound of the table (positive) or below the lower one (negative); 0 inside."""
    beyond_anatomy: Angles
    """Degrees outside of the range that functional anatomy leaves, of angles inside the table's; 0 inside."""
    counted: Bool[Tensor, "hand joint=15 axis=3"]
    """Mask of the angles that the source shows: all, or all but twist for landmarks alone."""
    bounds: Float[Tensor, "hand joint=15 axis=3 bound=2"]
    """Lower and upper bounds after functional anatomy, degrees."""
    depth: Float[Tensor, " hand"]
    """Greatest depth of a vertex inside another part of the hand, millimetres; NaN without a mesh."""
    deep: Float[Tensor, " hand"]
    """Number of vertices deeper than the tolerance; NaN without a mesh."""
    residual: Float[Tensor, " hand"]
    """Mean distance of the fitted to the given landmarks, millimetres; NaN for given angles."""
    bone_error: Float[Tensor, "hand landmark=21"]
    """Length of the given bone that ends in each landmark over that of the fitted hand, minus one; NaN for
    the wrist and for given angles."""
    shape: Float[Tensor, " hand"]
    """Greatest shape coefficient, standard deviations."""

    def __len__(self) -> int:
        return len(self.depth)

    @property
    def worst_range(self) -> Float[Tensor, " hand"]:
        """Greatest violation of a range among the angles that count, degrees."""
        return self._worst(self.beyond_range)

    @property
    def worst_anatomy(self) -> Float[Tensor, " hand"]:
        """Greatest violation of functional anatomy among the angles that count, degrees."""
        return self._worst(self.beyond_anatomy)

    @property
    def worst_bone(self) -> Float[Tensor, " hand"]:
        """Greatest relative error of a phalanx's length, as a share; NaN without any."""
        errors = self.bone_error[:, list(PHALANGES)].abs()
        greatest = errors.nan_to_num(0.0).amax(dim=1)
        return torch.where(errors.isfinite().any(dim=1), greatest, torch.nan)

    def _worst(self, violation: Angles) -> Float[Tensor, " hand"]:
        return (violation.abs() * self.counted).flatten(1).amax(dim=1)


@torch.no_grad()
def findings_of(hands: PosedHands, models: HandModels, knowledge: Knowledge) -> Findings:
    """Measure every hand.

    Args:
        hands: The hands.
        models: Hand models.
        knowledge: Ranges, functional anatomy and tolerance of penetration.
    """
    angles = hands.parameters.joint_angles
    table = knowledge.ranges
    refined = knowledge.anatomy.refine(table, angles)
    beyond = angles - table.clamp(angles)
    narrowed = torch.where(beyond == 0, angles - refined.clamp(angles), 0.0)
    counted = hands.posed[:, None, None].expand_as(angles).clone()
    counted[~hands.exact, :, AXES.index("twist")] = False
    depth, deep = _penetration(hands, models, knowledge.tolerance)
    residual, bones = _from_points(hands)
    return Findings(
        angles.rad2deg(),
        _rounded_off(beyond.rad2deg()),
        _rounded_off(narrowed.rad2deg()),
        counted,
        torch.stack([refined.lower, refined.upper], dim=-1).rad2deg(),
        depth,
        deep,
        residual,
        bones,
        hands.parameters.shape.abs().amax(dim=1),
    )


def _rounded_off(degrees: Angles) -> Angles:
    """Violations without those of rounding: files of hands have four decimals of a degree."""
    return torch.where(degrees.abs() < ROUNDING, 0.0, degrees.nan_to_num(0.0))


def _from_points(
    hands: PosedHands,
) -> tuple[Float[Tensor, " hand"], Float[Tensor, "hand landmark=21"]]:
    """Residual and errors of bone lengths of hands that were fitted to points."""
    distance = 1000 * (hands.landmarks - hands.points).norm(dim=-1)
    fitted = hands.posed & ~hands.exact
    residual = torch.where(fitted, distance.nanmean(dim=1), torch.nan)
    ratio = bone_lengths(hands.points) / bone_lengths(hands.landmarks) - 1
    return residual, torch.where(fitted[:, None], ratio, torch.nan)


def bone_lengths(
    landmarks: Float[Tensor, "*hand landmark=21 3"],
) -> Float[Tensor, "*hand landmark=21"]:
    """Length of the bone that ends in each landmark; NaN for the wrist.

    Args:
        landmarks: Any unit.
    """
    parents = [max(parent, 0) for parent in LANDMARK_PARENTS]
    lengths = (landmarks - landmarks[..., parents, :]).norm(dim=-1)
    first = torch.zeros(len(LANDMARKS), dtype=torch.bool)
    first[0] = True
    return torch.where(first, torch.nan, lengths)


def _penetration(
    hands: PosedHands, models: HandModels, tolerance: float
) -> tuple[Float[Tensor, " hand"], Float[Tensor, " hand"]]:
    """Depth of the deepest vertex, millimetres, and number of vertices deeper than the tolerance."""
    depth, deep = (torch.full((len(hands),), torch.nan) for _ in range(2))
    usable = hands.posed & hands.parameters.shape.isfinite().all(dim=1)
    for name in dict.fromkeys(hands.models):
        hand = models.named(name)
        own = torch.tensor([one == name for one in hands.models]) & usable
        if hand is None or not bool(own.any()):
            continue
        for rows in own.nonzero()[:, 0].split(_AT_ONCE):
            some = hands.parameters.select(rows)
            found = models.depths(name, hand(some.joint_angles, some.shape).vertices)
            depth[rows] = 1000 * found.amax(dim=1)
            deep[rows] = (found > tolerance).sum(dim=1).to(depth)
    return depth, deep
