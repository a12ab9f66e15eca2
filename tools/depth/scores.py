"""Errors of fitted hands, and intervals that resample groups of hands which are alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from depth.sets import SecondCamera
from hand_recon.camera import project
from hand_recon.evaluation.alignment import align_official
from hand_recon.evaluation.point_error import point_errors
from hand_recon.tables.intervals import Bootstrap, Interval, interval

SCALES: Final = torch.logspace(-1, 1, 81, base=2, dtype=torch.float64)
"""Scales of a hand that are tried before the best one is refined."""

REFINEMENTS: Final = 12
"""Steps of Newton's method for the scale."""


def aligned_errors(
    ground_truth: Float[Tensor, "hand landmark=21 3"], found: Float[Tensor, "hand landmark=21 3"]
) -> Float[Tensor, "hand landmark=21"]:
    """Distance of each landmark after Procrustes alignment, millimetres; its mean is PA-MPJPE (E_J)."""
    return 1000 * point_errors(ground_truth, align_official(ground_truth, found))


def second_view_errors(
    found: Float[Tensor, "hand landmark=21 3"], second: SecondCamera
) -> Float[Tensor, " hand"]:
    """Mean distance of the projections from the landmarks in the second camera, pixels.

    One view leaves the scale about the first camera's centre open: a hand twice as large and twice as far
    away looks the same. Of all similarities it alone keeps the first camera's view, so each hand is scaled
    about that centre to meet the second camera's landmarks best, and nothing else is aligned: errors of the
    hand's orientation count, which Procrustes alignment hides.

    Args:
        found: Landmarks, first camera's frame, metres.
        second: The second camera and its landmarks.
    """
    points = found.double() @ second.rotation.mT
    residuals = _residuals(SCALES[:, None], points[None], second)
    best = SCALES[residuals.square().sum(dim=(-2, -1)).nan_to_num(torch.inf).argmin(dim=0)]
    for _ in range(REFINEMENTS):
        step = 1e-6 * best
        here = _residuals(best, points, second)
        slope = (_residuals(best + step, points, second) - here) / step[:, None, None]
        change = (slope * here).sum(dim=(1, 2)) / slope.square().sum(dim=(1, 2))
        best = (best - change).clamp(float(SCALES[0]), float(SCALES[-1]))
    return _residuals(best, points, second).norm(dim=-1).mean(dim=-1)


def _residuals(
    scale: Float[Tensor, "*batch"],
    points: Float[Tensor, "*batch landmark=21 3"],
    second: SecondCamera,
) -> Tensor:
    """Projections minus landmarks of hands scaled about the first camera's centre, pixels."""
    moved = scale[..., None, None] * points + second.translation
    cameras = second.intrinsics.expand(*moved.shape[:-2], 3, 3)
    return project(moved, cameras) - second.landmarks_2d


@dataclass(frozen=True)
class Mean:
    """Mean over hands with its 95 % interval."""

    value: float
    interval: Interval

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.interval.low:.2f} … {self.interval.high:.2f})"

    def signed(self) -> str:
        """The same with signs, for differences."""
        return f"{self.value:+.2f} ({self.interval.low:+.2f} … {self.interval.high:+.2f})"


def grouped_mean(values: Float[Tensor, " hand"], groups: Sequence[str]) -> Mean:
    """Mean over all hands, with a bootstrap interval that draws whole groups.

    Args:
        values: One value per hand.
        groups: Group of each hand.
    """
    array = values.detach().double().numpy()
    _, rows = np.unique(np.array(groups), return_inverse=True)
    # Of each group the sum and the number of hands: groups differ in size.
    columns = np.stack([np.bincount(rows, array), np.bincount(rows)], axis=1)
    draws = Bootstrap().means(columns)
    return Mean(float(array.mean()), interval(draws[:, 0] / draws[:, 1]))
