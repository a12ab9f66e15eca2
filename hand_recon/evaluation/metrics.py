"""PA-MPJPE (E_J), PA-MPVPE (E_V), E_RV, MPJPE, AUC and F-scores over a dataset (Sec. 4.1, metrics).

Scores without suffix follow the benchmarks' alignment, which may mirror a hand; `_proper` ones an alignment
without reflection, which shows a mirrored hand; `_unaligned` ones have no alignment.
"""

from jaxtyping import Bool, Float, Int
from torch import Tensor
from torchmetrics.utilities import rank_zero_warn

from hand_recon.evaluation.finite import require_finite
from hand_recon.evaluation.per_sample import PerSampleMetric
from hand_recon.evaluation.scores import (
    LANDMARK_SCORES,
    VERTEX_SCORES,
    HandPoints,
    landmark_scores,
    vertex_scores,
)

MILLIMETRES = 1000.0
"""Millimetres per metre: errors are reported in millimetres."""


class HandMetrics(PerSampleMetric):
    """The paper's 3D metrics: every column of `LANDMARK_SCORES` and `VERTEX_SCORES`, averaged.

    Errors in millimetres, AUC and F-scores from 0 to 1. Samples whose ground truth has a NaN are left
    out with a warning; vertex metrics are absent where no ground truth has vertices.
    """

    def __init__(self) -> None:
        """Create an empty metric."""
        super().__init__({"landmarks": len(LANDMARK_SCORES), "vertices": len(VERTEX_SCORES)})
        self.last_per_hand: tuple[Tensor, dict[str, Tensor]] = self.per_hand()

    def update(
        self, prediction: HandPoints, ground_truth: HandPoints, index: Int[Tensor, " hand"]
    ) -> None:
        """Add a batch.

        Args:
            prediction: Predicted points; vertices are needed where the ground truth has them.
            ground_truth: Ground truth; NaN for samples without, no vertices for datasets without them.
            index: Position of each sample in its dataset: a repeated sample counts once.

        Raises:
            ValueError: A prediction is not finite, or its vertices are absent or do not correspond.
        """
        require_finite("landmarks", prediction.landmarks, index)
        ground_truth, prediction = ground_truth.double(), prediction.double()
        known = _known(ground_truth.landmarks)
        scores = landmark_scores(ground_truth[known], prediction[known])
        rows = {"landmarks": _spread(scores, known)}
        if ground_truth.vertices is not None:
            if prediction.vertices is not None:
                require_finite("vertices", prediction.vertices, index)
            known = known & _known(ground_truth.vertices)
            scores = vertex_scores(ground_truth[known], prediction[known])
            rows["vertices"] = _spread(scores, known)
        self.record(index, **rows)

    def compute(self) -> dict[str, float]:
        """Mean of every score over distinct samples.

        Raises:
            ValueError: Only some updates had ground-truth vertices, or an index is not unique.
        """
        # Here, because only now every process has the rows of all.
        self.last_per_hand = self.per_hand()
        return self._means("landmarks", LANDMARK_SCORES) | self._means("vertices", VERTEX_SCORES)

    def per_hand(self) -> tuple[Int[Tensor, " hand"], dict[str, Float[Tensor, " hand"]]]:
        """Index and scores of every distinct sample, in the units of `compute`; NaN without ground truth."""
        columns: dict[str, Tensor] = {}
        tables = (("landmarks", LANDMARK_SCORES), ("vertices", VERTEX_SCORES))
        for table, names in tables:
            rows = self.distinct(table)
            if len(rows):
                columns |= {
                    name: rows[:, column] * _report_unit(name) for column, name in enumerate(names)
                }
        return self.distinct_index(), columns

    def _means(self, table: str, names: tuple[str, ...]) -> dict[str, float]:
        rows = self.distinct(table)
        known = rows.isfinite().all(dim=-1)
        if not known.all():
            rank_zero_warn(
                f"{int((~known).sum())} of {len(rows)} samples have no ground truth for their "
                f"{table} (NaN) and are left out of its metrics."
            )
        if not known.any():
            return {}
        means = rows[known].mean(dim=0).tolist()
        return {name: mean * _report_unit(name) for name, mean in zip(names, means, strict=True)}


def _spread(scores: Float[Tensor, "known score"], known: Bool[Tensor, " hand"]) -> Tensor:
    """One row per hand: the scores of the known ones, NaN for the others."""
    rows = scores.new_full((len(known), scores.shape[-1]), float("nan"))
    rows[known] = scores
    return rows


def _known(points: Float[Tensor, "hand point 3"]) -> Bool[Tensor, " hand"]:
    return points.isfinite().flatten(start_dim=1).all(dim=1)


def _report_unit(name: str) -> float:
    return MILLIMETRES if name.startswith(("E_", "MPJPE")) else 1.0
