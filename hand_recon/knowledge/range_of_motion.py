"""Hand biomechanics: every joint stays inside its range of motion (Sec. 3.2, Eq. 1)."""

from jaxtyping import Float
from torch import Tensor

from hand_recon.knowledge.ranges import RangeOfMotion


def range_of_motion_loss(
    joint_angles: Float[Tensor, "*batch joint=15 axis=3"], ranges: RangeOfMotion
) -> Float[Tensor, "*batch"]:
    """Squared violation of the ranges, summed over joints and axes: L_pose of Eq. 1.

    Zero, with zero gradient, for every pose inside the ranges. The paper calls the loss L_pose and this
    source of knowledge biomechanics (row 2 of Table 1); in configurations, logs and code it is
    `range_of_motion`. `prior=biomechanics` is the row of the table, and the metric `ROM` is a share of hands.

    Args:
        joint_angles: Bend, splay and twist of each joint, radians.
        ranges: Bounds for the same joints and axes, one set for all hands or one per hand.

    Returns:
        One value per hand, squared radians.
    """
    above = (joint_angles - ranges.upper).clamp(min=0)
    below = (ranges.lower - joint_angles).clamp(min=0)
    return (above + below).square().sum(dim=(-2, -1))
