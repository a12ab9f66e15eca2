"""How natural predicted hands are: joints outside their ranges, and skin inside the hand (Table 1, PR).

Neither needs ground truth, so that they are measured on any picture.
"""

import math
from typing import Final, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.evaluation.per_sample import PerSampleMetric, require_finite
from hand_recon.knowledge.ranges import RangeOfMotion

ROM_TOLERANCE: Final = math.radians(22.5)
"""How far beyond its range a joint may be before the hand counts as unnatural, radians.

The tables hold means of active motion, which half of all people exceed. This is two standard deviations
between people: the sixteen of Latz et al. (Hand 14, 2019: four bounds of four fingers) are 11.2° on average.
`docs/ranges.md` has what it does to natural and unnatural hands.
"""


@runtime_checkable
class Penetration(Protocol):
    """What `Plausibility` needs of `hand_recon.knowledge.penetration.non_penetration.NonPenetration`."""

    tolerance: float
    """Depth that soft skin takes, metres."""

    def depths(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch vertex"]:
        """How deep each vertex is inside the hand, metres; 0 outside."""
        ...


def range_violation(
    joint_angles: Float[Tensor, "*batch joint=15 axis=3"], ranges: RangeOfMotion
) -> Float[Tensor, "*batch"]:
    """The largest angle by which a joint of each hand is outside its range, radians; 0 inside.

    Args:
        joint_angles: Bend, splay and twist of each joint, radians.
        ranges: Bounds for the same joints and axes, one set for all hands or one per hand.
    """
    above = joint_angles - ranges.upper.to(joint_angles)
    below = ranges.lower.to(joint_angles) - joint_angles
    return torch.maximum(above, below).flatten(-2).amax(dim=-1).clamp(min=0)


class Plausibility(PerSampleMetric):
    """Percentage of penetrating hands (`PR`), and of hands that violate a range (`ROM`).

    A hand violates a range when a joint is beyond it by more than `ROM_TOLERANCE`. `ROM_degrees` is the mean
    over hands of the largest violation, without tolerance. Ranges are the table's own, never those that
    Eq. 2–3 refine: one yardstick for every prior.
    """

    def __init__(self, ranges: RangeOfMotion, non_penetration: Penetration | None = None) -> None:
        """Start without samples.

        Args:
            ranges: Ranges of motion of the hand at hand.
            non_penetration: Measures depths; without it there is no `PR`.
        """
        super().__init__({"violation": 1, "depth": 1})
        self.ranges = ranges
        self.non_penetration = non_penetration

    def update(
        self,
        joint_angles: Float[Tensor, "hand joint=15 axis=3"],
        vertices: Float[Tensor, "hand vertex 3"],
        index: Int[Tensor, " hand"],
    ) -> None:
        """Measure a batch.

        Args:
            joint_angles: Bend, splay and twist of each joint, radians.
            vertices: The posed surface in any frame, metres.
            index: Position of each sample in its dataset: one that comes twice counts once.

        Raises:
            ValueError: A prediction is not finite.
        """
        require_finite("joint angles", joint_angles, index)
        rows = {"violation": range_violation(joint_angles, self.ranges)[:, None]}
        if self.non_penetration is not None:
            require_finite("vertices", vertices, index)
            rows["depth"] = self.non_penetration.depths(vertices).amax(dim=-1, keepdim=True)
        self.record(index, **rows)

    def compute(self) -> dict[str, float]:
        """Percentages and mean over distinct samples; empty without samples.

        Raises:
            ValueError: An index is not unique.
        """
        violation = self.distinct("violation")
        if len(violation) == 0:
            return {}
        scores = {
            "ROM": 100 * float((violation > ROM_TOLERANCE).double().mean()),
            "ROM_degrees": math.degrees(float(violation.mean())),
        }
        if self.non_penetration is None:
            return scores
        deep = self.distinct("depth") > float(self.non_penetration.tolerance)
        return {"PR": 100 * float(deep.double().mean()), **scores}
