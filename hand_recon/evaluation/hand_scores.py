"""All metrics of a reconstruction that its labels allow (Sec. 4.1)."""

from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor, nn

from hand_recon.camera import REFERENCE_SIZE
from hand_recon.evaluation.calibration import Calibration
from hand_recon.evaluation.landmarks_2d import Landmarks2D
from hand_recon.evaluation.metrics import HandMetrics
from hand_recon.evaluation.plausibility import Penetration, Plausibility
from hand_recon.evaluation.scores import HandPoints
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.processes import process_group
from hand_recon.schema import HandBatch, HandPrediction


class Scores(nn.Module):
    """2D error, plausibility and calibration of every batch; 3D errors where there is ground truth.

    Args:
        ranges: Ranges of motion for the violations; the same for every model that is compared.
        non_penetration: Eq. 4 on the hand (`NonPenetration`), for the penetration rate; none leaves it out.
        calibration: Whether to score the predicted σ. A fit does not predict σ but takes it as given.
    """

    def __init__(
        self,
        ranges: RangeOfMotion,
        non_penetration: Penetration | None,
        *,
        calibration: bool = True,
    ) -> None:
        super().__init__()
        self.in_3d = HandMetrics()
        self.in_2d = Landmarks2D()
        self.plausibility = Plausibility(ranges, non_penetration)
        self.calibration = Calibration() if calibration else None
        self._has_3d = False
        self.last_per_hand: tuple[Tensor, dict[str, Tensor]] = torch.empty(0), {}

    def update(self, batch: HandBatch, prediction: HandPrediction) -> None:
        """Add a batch."""
        self.in_2d.update(
            prediction.landmarks_2d,
            batch.landmarks_2d,
            batch.labelled,
            batch.index,
            crop_size=batch.crop_size,
        )
        parameters = prediction.parameters
        self.plausibility.update(parameters.joint_angles, prediction.vertices, batch.index)
        if self.calibration is not None:
            to_reference = REFERENCE_SIZE / batch.crop_size
            noise = batch.label_noise
            self.calibration.update(
                (prediction.landmarks_2d - batch.landmarks_2d) * to_reference,
                prediction.log_sigma,
                batch.labelled,
                None if noise is None else noise * to_reference,
                batch.index,
            )
        if batch.landmarks_3d is not None:
            self._has_3d = True
            vertices = None if batch.vertices is None else prediction.vertices
            self.in_3d.update(
                HandPoints(prediction.landmarks_3d, vertices),
                HandPoints(batch.landmarks_3d, batch.vertices),
                batch.index,
            )

    def compute(self) -> dict[str, float]:
        """Every score by name; `last_per_hand` keeps the scores of each hand even after a reset."""
        # A process whose own hands have no ground truth takes part as well: the others wait for it.
        has_3d = process_group.in_any_process(self._has_3d)
        in_3d = self.in_3d.compute() if has_3d else {}
        if has_3d:
            self.last_per_hand = self.in_3d.last_per_hand
        calibration = {} if self.calibration is None else self.calibration.compute()
        return in_3d | self.in_2d.compute() | self.plausibility.compute() | calibration

    def per_hand(self) -> tuple[Int[Tensor, " hand"], dict[str, Tensor]]:
        """Index and 3D scores of each hand of this process, in mm or 0 to 1; empty without ground truth."""
        if not self._has_3d:
            return torch.empty(0, dtype=torch.int64), {}
        return self.in_3d.per_hand()

    def reset(self) -> None:
        """Remove all hands."""
        metrics: tuple[Any, ...] = (self.in_3d, self.in_2d, self.plausibility, self.calibration)
        for metric in metrics:
            if metric is not None:
                metric.reset()
        self._has_3d = False
