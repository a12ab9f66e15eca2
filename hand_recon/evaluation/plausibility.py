"""Plausibility of predicted hands: violated ranges of motion, and penetration rate (Table 1, PR).

Neither needs ground truth, so that both are measured on any image.
"""

import math
from typing import Final, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.per_sample import PerSampleMetric
from hand_recon.knowledge.ranges import RangeOfMotion

ROM_TOLERANCE: Final = math.radians(22.5)
"""Largest range violation of a joint at which a hand still counts as natural, radians.

The tables hold means of active motion, which half of all people exceed. The tolerance is two standard
deviations between people: the sixteen of Latz et al. (Hand 14, 2019: four bounds of four fingers) are 11.2°
on average. `docs/ranges.md` has its effect on natural and unnatural hands.
"""


@runtime_checkable
class Penetration(Protocol):
    """Interface of `hand_recon.knowledge.penetration.non_penetration.NonPenetration` for `Plausibility`."""

    tolerance: float
    """Depth up to which a vertex does not count as penetrating (soft skin), metres."""

    def depths(self, vertices: Float[Tensor, "*batch vertex 3"]) -> Float[Tensor, "*batch vertex"]:
        """Depth of each vertex inside the hand, metres; 0 outside."""
        ...


def range_violation(
    joint_angles: Float[Tensor, "*batch joint=15 axis=3"], ranges: RangeOfMotion
) -> Float[Tensor, "*batch"]:
    """Largest angle by which a joint of each hand is outside its range, radians; 0 inside.

    Args:
        joint_angles: Bend, splay and twist of each joint, radians.
        ranges: Bounds for the same joints and axes, one set for all hands or one per hand.
    """
    above = joint_angles - ranges.upper.to(joint_angles)
    below = ranges.lower.to(joint_angles) - joint_angles
    return torch.maximum(above, below).flatten(-2).amax(dim=-1).clamp(min=0)


class Plausibility(PerSampleMetric):
    """Penetration rate (`PR`) and rate of hands that violate a range of motion (`ROM`), percent.

    A hand violates a range when a joint is beyond it by more than `ROM_TOLERANCE`. `ROM_degrees` is the mean
    over hands of the largest violation, without tolerance. The ranges are the table's own, not those that
    Eq. 2–3 refine, so that every prior is measured alike.
    """

    def __init__(self, ranges: RangeOfMotion, non_penetration: Penetration | None = None) -> None:
        """Create an empty metric.

        Args:
            ranges: Ranges of motion of the hand.
            non_penetration: Measures the vertices' depths; without it there is no `PR`.
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
        """Add a batch.

        Args:
            joint_angles: Bend, splay and twist of each joint, radians.
            vertices: Posed surface in any frame, metres.
            index: Position of each sample in its dataset: a repeated sample counts once.

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
