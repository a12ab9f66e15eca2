"""Distance of joint angles to their limits by ranges of motion and functional anatomy (Eq. 1-3)."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float

from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion

NEAR: Final = 12.0
"""Distance to a limit from which on a joint counts as near it, degrees."""

LEAST_FREEDOM: Final = 15.0
"""Smallest range in which an angle can be near a limit, degrees; a hinge's angle is always at its limits."""


@dataclass(frozen=True)
class LimitState:
    """Joint angles of hands in relation to their limits."""

    closeness: Float[np.ndarray, "hand joint=15"]
    """0 for a joint that is `NEAR` or farther from every limit, 1 for one at a limit; NaN without angles."""
    excess: Float[np.ndarray, "hand joint=15 axis=3"]
    """Angle beyond the limit, degrees; 0 inside the range, negative below the lower limit."""


def limit_state(
    joint_angles_degrees: Float[np.ndarray, "hand joint=15 axis=3"], ranges: RangeOfMotion
) -> LimitState:
    """Compare joint angles with the ranges that functional anatomy leaves to each pose.

    Args:
        joint_angles_degrees: Bend, splay and twist of each joint, degrees.
        ranges: The table's ranges, one set for all hands.
    """
    angles = torch.from_numpy(np.asarray(joint_angles_degrees, dtype=np.float64)).deg2rad()
    left = FunctionalAnatomy().refine(ranges, angles)
    lower, upper = left.lower.rad2deg().numpy(), left.upper.rad2deg().numpy()
    below, above = joint_angles_degrees - lower, upper - joint_angles_degrees
    is_free = upper - lower >= LEAST_FREEDOM
    nearness = 1 - np.minimum(below, above) / NEAR
    closeness = np.where(is_free, nearness, 0.0).clip(0.0, 1.0).max(axis=-1)
    excess = np.maximum(-above, 0.0) + np.minimum(below, 0.0)
    closeness[np.isnan(joint_angles_degrees).any(axis=(-2, -1))] = np.nan
    return LimitState(closeness, excess)
