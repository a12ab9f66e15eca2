"""Several minima of the loss of each hand, with a Gaussian about each (Sec. 3.3).

One view leaves the depth of a finger open, and the least loss of a single frame is now one, now another of
minima that look alike. In a clip, the neighbouring frames choose among them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.second_order.laplace import curvature_of, damped, log_volume_of
from hand_recon.fitting.second_order.least_squares import Problem
from hand_recon.fitting.second_order.levenberg_marquardt import Reached
from hand_recon.fitting.second_order.unknowns import PLACE, SHAPE, Unknowns
from hand_recon.schema import HandParameters

POSE: Final = 51
"""Unknowns without the shape: joint angles, rotation, place."""

FIXED_SIGMA: Final = 1e-3
"""Standard deviation of angles whose range has no width, radians."""

Information = Float[Tensor, "hand coordinate=51 coordinate=51"]


@dataclass(frozen=True)
class Minima:
    """Results of several starts of each hand, and how probable each is."""

    parameters: HandParameters
    """Hands, hand × minimum."""
    place: Float[Tensor, "hand minimum 3"]
    """Origin of the hand's frame: x / z, y / z, and the logarithm of z in metres."""
    information: Float[Tensor, "hand minimum coordinate=51 coordinate=51"]
    """Inverse covariance about each minimum of its joint angles (radians), of a rotation that is applied last
    (axis angle in the camera's axes, radians) and of its place."""
    cost: Float[Tensor, "hand minimum"]
    """Negative logarithm of each minimum's probability, up to a constant of the hand; infinite for one that
    repeats another, or whose loss is not finite."""

    def __len__(self) -> int:
        return len(self.cost)

    def __getitem__(self, hands: slice) -> "Minima":
        """Minima of some of the hands."""
        return Minima(
            self.parameters.select(hands),
            self.place[hands],
            self.information[hands],
            self.cost[hands],
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Minima of several batches as one.

        Args:
            parts: Minima with the same number per hand.
        """
        return cls(
            HandParameters.join([part.parameters for part in parts]),
            torch.cat([part.place for part in parts]),
            torch.cat([part.information for part in parts]),
            torch.cat([part.cost for part in parts]),
        )

    @classmethod
    def of(cls, problem: Problem, reached: Reached, repeated: Tensor) -> Self:
        """Gaussians about the results of some starts.

        Args:
            problem: The loss of every start, with a prior that bounds every unknown.
            reached: The results, those of each hand behind each other.
            repeated: Mask of the results that repeat another, hand × minimum.
        """
        hands, count = repeated.shape
        unknowns = reached.unknowns
        matrix = damped(curvature_of(reached.model).double())
        factor, failed = torch.linalg.cholesky_ex(matrix)
        cost = reached.model.value.double() - log_volume_of(factor)
        cost = cost.masked_fill(failed != 0, torch.inf).nan_to_num(torch.inf)
        information = _of_pose(matrix, reached.model.free, problem.observation.intrinsics.double())
        found = unknowns.parameters(problem.inverse)

        def by_hand(value: Tensor) -> Tensor:
            return value.unflatten(0, (hands, count))

        return cls(
            HandParameters(
                by_hand(found.joint_angles),
                by_hand(found.shape),
                by_hand(found.root_rotation),
                by_hand(found.translation),
            ),
            by_hand(_rays(unknowns, problem.inverse)),
            by_hand(information),
            by_hand(cost).masked_fill(repeated, torch.inf),
        )


def _of_pose(
    matrix: Float[Tensor, "hand unknown unknown"], free: Tensor, intrinsics: Tensor
) -> Information:
    """Second derivatives by pose and place, with the shape at its best, and the place as in `Minima`."""
    hands, shapes = len(matrix), SHAPE.stop - SHAPE.start
    pose, shape = slice(0, -shapes), slice(-shapes, None)
    across = matrix[:, pose, shape]
    reduced = matrix[:, pose, pose] - across @ torch.linalg.solve(
        matrix[:, shape, shape], across.mT
    )
    whole = torch.diag_embed(torch.full((hands, POSE), FIXED_SIGMA**-2, dtype=matrix.dtype))
    kept = free[pose]
    whole[:, kept[:, None], kept] = (reduced + reduced.mT) / 2
    # By pixels before, by rays after.
    slope = torch.eye(POSE, dtype=matrix.dtype).repeat(hands, 1, 1)
    pixels = slice(PLACE.start, PLACE.start + 2)
    slope[:, pixels, pixels] = intrinsics[:, :2, :2]
    return slope.mT @ whole @ slope


def _rays(unknowns: Unknowns, inverse: Float[Tensor, "hand 3 3"]) -> Float[Tensor, "hand 3"]:
    """Origins of hands: x / z, y / z and log z."""
    pixel = torch.cat([unknowns.place[:, :2], torch.ones_like(unknowns.place[:, :1])], dim=1)
    ray = (inverse @ pixel[..., None])[..., :2, 0]
    return torch.cat([ray, unknowns.place[:, 2:]], dim=1)
