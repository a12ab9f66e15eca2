"""Scores of predicted hands in photographs, per hand, with bootstrap intervals."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from depth.scores import Mean, aligned_errors, grouped_mean, second_view_errors
from hand_recon.camera import REFERENCE_SIZE
from hand_recon.evaluation.calibration import Calibration
from hand_recon.evaluation.landmarks_2d import landmark_error_2d
from hand_recon.evaluation.plausibility import ROM_TOLERANCE, range_violation
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.schema import HandPrediction
from photos.sets import PhotoSet


@dataclass(frozen=True)
class Scored:
    """Scores of each hand of a set by a method; tensors have one value per hand."""

    hands: PhotoSet
    method: str
    prediction: HandPrediction
    values: dict[str, Float[Tensor, " hand"]]
    """E_2D (pixels of a 224-pixel crop), PCK@0.10, PR, ROM (0 or 100), and where a clip has them PA-MPJPE
    (mm) and the error in the second camera (pixels)."""
    calibration: dict[str, float]
    """Scores of σ, as `hand_recon.evaluation.calibration.Calibration` names them."""

    def mean(self, name: str, rows: Tensor | None = None) -> Mean:
        """Mean of a score over hands, with its interval.

        Args:
            name: A key of `values`.
            rows: Positions of the hands; None for all.
        """
        chosen = torch.arange(len(self.hands)) if rows is None else rows
        blocks = [self.hands.blocks[row] for row in chosen.tolist()]
        return grouped_mean(self.values[name][chosen], blocks)

    def group(self, kind: str, name: str) -> Tensor:
        """Positions of the hands of a group."""
        found = [row for row, group in enumerate(self.hands.groups[kind]) if group == name]
        return torch.tensor(found, dtype=torch.long)


def score(hands: PhotoSet, method: str, prediction: HandPrediction, hand: HandModel) -> Scored:
    """Score a prediction.

    Args:
        hands: The photographs.
        method: Name for tables.
        prediction: The predicted hands, in the order of the photographs.
        hand: Hand model of the prediction.
    """
    batch = hands.batch
    error = landmark_error_2d(
        prediction.landmarks_2d, batch.landmarks_2d, batch.labelled, batch.crop_size
    )
    penetration = NonPenetration(hand)
    depth = torch.cat([penetration.depths(part) for part in prediction.vertices.split(256)])
    violation = range_violation(prediction.parameters.joint_angles, load_ranges("literature"))
    values = {
        "E_2D": error.nanmean(dim=-1),
        "PCK@0.10": 100 * (error <= 0.1 * REFERENCE_SIZE).double().mean(dim=-1),
        "PR": 100 * (depth.amax(dim=-1) > penetration.tolerance).double(),
        "ROM": 100 * (violation > ROM_TOLERANCE).double(),
    }
    if batch.landmarks_3d is not None:
        aligned = aligned_errors(batch.landmarks_3d.double(), prediction.landmarks_3d.double())
        values["PA-MPJPE"] = aligned.mean(dim=-1)
    if hands.second is not None:
        values["second view"] = second_view_errors(prediction.landmarks_3d, hands.second)
    return Scored(hands, method, prediction, values, _calibration(hands, prediction))


def _calibration(hands: PhotoSet, prediction: HandPrediction) -> dict[str, float]:
    batch = hands.batch
    metric = Calibration()
    residual = (prediction.landmarks_2d - batch.landmarks_2d) * (REFERENCE_SIZE / batch.crop_size)
    metric.update(residual, prediction.log_sigma, batch.labelled, None, batch.index)
    return metric.compute()
