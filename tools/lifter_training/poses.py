"""Hands to look at: gestures, natural poses and poses from the ranges of motion, without penetration."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.synthetic.gestures import DIP_FOLLOWS_PIP, sample_pose
from hand_recon.data.synthetic.plausible import deepest_overlap
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, FINGERS
from hand_recon.knowledge.natural_pose import natural_poses
from hand_recon.knowledge.ranges import RangeOfMotion

OVERLAP_ALLOWED: Final = 0.004
"""Accepted penetration depth of the bones' capsules, metres, as for synthetic images."""

LEAST_MCP_BEND: Final = -0.35
"""Least bend of an MCP in a pose from the ranges, radians; few hands bend back farther by themselves."""

_BEND, _SPLAY = AXES.index("bend"), AXES.index("splay")
_MCP, _PIP, _DIP = (
    [ARTICULATED.index(f"{finger} {joint}") for finger in FINGERS[1:]]
    for joint in ("MCP", "PIP", "DIP")
)
_THUMB: Final = [index for index, joint in enumerate(ARTICULATED) if joint.startswith("thumb")]
_TOGETHER: Final = 0.8
"""Correlation of the bends of neighbouring fingers, in half of the poses; none in the other half."""

_PIECE: Final = 2000


@dataclass(frozen=True)
class Poses:
    """Settings of the poses."""

    hands: int = 60_000
    """Hands that are drawn; those that penetrate themselves, a fifth to a third, are left out."""
    from_ranges: float = 0.3
    """Share of poses that are drawn from the ranges of motion."""
    natural: float = 0.35
    """Share of poses that are from the Gaussian of natural poses; the others are mixtures of gestures."""


def sample_hands(
    poses: Poses, hand: HandModel, ranges: RangeOfMotion, seed: int
) -> Float[Tensor, "hand landmark=21 3"]:
    """Draw hands and return their landmarks in the hand's frame, metres.

    Args:
        poses: Settings.
        hand: Hand model; its shapes are drawn as well.
        ranges: Ranges of motion.
        seed: Seed of the draws.
    """
    random = np.random.default_rng(seed)
    wide, natural = (round(poses.hands * share) for share in (poses.from_ranges, poses.natural))
    gestures = [sample_pose(random) for _ in range(poses.hands - wide - natural)]
    generator = torch.Generator().manual_seed(seed)
    angles = torch.cat(
        [
            torch.tensor(np.array(gestures).reshape(-1, 15, 3), dtype=torch.float32),
            sample_in_ranges(ranges, wide, generator),
            ranges.clamp(sample_natural(natural, generator)),
        ]
    )
    shape = torch.randn(len(angles), 10, generator=generator).clamp(-3, 3)
    pieces = zip(angles.split(_PIECE), shape.split(_PIECE), strict=True)
    with torch.no_grad():
        landmarks = torch.cat([hand(*piece).landmarks for piece in pieces])
    free = [deepest_overlap(points) < OVERLAP_ALLOWED for points in landmarks.numpy()]
    return landmarks[torch.tensor(free)]


def sample_in_ranges(
    ranges: RangeOfMotion, count: int, generator: torch.Generator
) -> Float[Tensor, "pose joint=15 axis=3"]:
    """Draw poses from ranges of motion, radians.

    Bends of a finger's MCP and PIP are uniform; in half of the poses those of the four fingers go together.
    A DIP follows its PIP, with noise. Splay is uniform over what a bent MCP leaves of its range. The thumb's
    angles are uniform. Nothing twists.

    Args:
        ranges: The ranges.
        count: Number of poses.
        generator: Source of the draws.
    """
    angles = torch.zeros(count, 15, 3)
    lower, upper = ranges.lower.float(), ranges.upper.float()
    least = lower[_MCP, _BEND].clamp(min=LEAST_MCP_BEND)
    mcp = least + _fingers(count, generator) * (upper[_MCP, _BEND] - least)
    pip = _fingers(count, generator) * upper[_PIP, _BEND]
    dip = DIP_FOLLOWS_PIP * pip + 0.25 * torch.randn(count, 4, generator=generator)
    angles[:, _MCP, _BEND], angles[:, _PIP, _BEND] = mcp, pip
    angles[:, _DIP, _BEND] = dip.clamp(min=0).minimum(upper[_DIP, _BEND])
    splay = _uniform(lower[_MCP, _SPLAY], upper[_MCP, _SPLAY], count, generator)
    angles[:, _MCP, _SPLAY] = 0.8 * splay * (1 - (mcp / upper[_MCP, _BEND]).clamp(0, 1))
    angles[:, _THUMB] = _uniform(lower[_THUMB], upper[_THUMB], count, generator)
    return angles


def sample_natural(count: int, generator: torch.Generator) -> Float[Tensor, "pose joint=15 axis=3"]:
    """Draw poses from the Gaussian of natural poses, radians.

    Args:
        count: Number of poses.
        generator: Source of the draws.
    """
    mean, covariance = (table.float() for table in natural_poses())
    factor = torch.linalg.cholesky(covariance)
    drawn = mean + torch.randn(count, len(mean), generator=generator) @ factor.mT
    return drawn.unflatten(-1, (15, 3))


def _uniform(lower: Tensor, upper: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Uniform draws between bounds, with one more axis in front."""
    return lower + torch.rand(count, *lower.shape, generator=generator) * (upper - lower)


def _fingers(count: int, generator: torch.Generator) -> Float[Tensor, "pose finger=4"]:
    """Uniform draws 0 to 1 for four fingers, which go together in half of the poses."""
    share = torch.where(torch.rand(count, 1, generator=generator) < 0.5, _TOGETHER, 0.0)
    common = torch.randn(count, 1, generator=generator)
    own = torch.randn(count, 4, generator=generator)
    return torch.special.ndtr(share * common + (1 - share.square()).sqrt() * own)
