"""Every score of every hand, before any averaging: the columns of the metrics (Sec. 4.1).

Scored in double precision on the CPU: on any device the numbers are the same, and the official
ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import WRIST, fit_similarity, root_relative
from hand_recon.evaluation.f_score import f_score
from hand_recon.evaluation.point_error import auc, point_errors

LANDMARK_SCORES: Final = (
    "E_J", "AUC_J",
    "E_J_proper", "AUC_J_proper",
    "E_J_unaligned", "AUC_J_unaligned",
    "MPJPE",
)  # fmt: skip
"""The columns of `landmark_scores`. Errors in metres, areas 0 to 1."""

VERTEX_SCORES: Final = (
    "E_V", "AUC_V", "F@5", "F@15",
    "E_V_proper", "AUC_V_proper", "F@5_proper", "F@15_proper",
    "E_V_unaligned", "AUC_V_unaligned", "F@5_unaligned", "F@15_unaligned",
    "E_RV",
)  # fmt: skip
"""The columns of `vertex_scores`. Errors in metres, areas and F-scores 0 to 1."""

CHUNK: Final = 64
"""Hands scored together, so that intermediate results stay in the cache."""


@dataclass(frozen=True)
class HandPoints:
    """The points of hands that are scored."""

    landmarks: Float[Tensor, "hand landmark=21 3"]
    """In the order of `hand_recon.hand.skeleton.LANDMARKS`, metres."""
    vertices: Float[Tensor, "hand vertex 3"] | None = None
    """In the landmarks' frame, metres; absent where a dataset has no surface."""

    def __len__(self) -> int:
        return len(self.landmarks)

    def __getitem__(self, hands: Tensor | slice) -> Self:
        """Some of the hands."""
        vertices = None if self.vertices is None else self.vertices[hands]
        return type(self)(landmarks=self.landmarks[hands], vertices=vertices)

    def double(self) -> Self:
        """The same points outside the graph, in double precision, on the CPU."""
        # First to the CPU: not every accelerator knows double precision.
        vertices = None if self.vertices is None else self.vertices.detach().cpu().double()
        return type(self)(landmarks=self.landmarks.detach().cpu().double(), vertices=vertices)


def landmark_scores(
    ground_truth: HandPoints, prediction: HandPoints
) -> Float[Tensor, "hand score"]:
    """The columns of `LANDMARK_SCORES`.

    E_J and AUC_J follow the official alignment, `_proper` the one without reflections, `_unaligned`
    none. MPJPE is relative to the wrist, neither turned nor scaled, as DexYCB's root-relative
    error.
    """
    ground_truth, prediction = ground_truth.double(), prediction.double()
    with _full_precision():
        aligned = _aligned_scores(ground_truth.landmarks, prediction.landmarks, _errors_and_area)
        wrist_relative = point_errors(
            root_relative(ground_truth.landmarks, ground_truth.landmarks[:, WRIST]),
            root_relative(prediction.landmarks, prediction.landmarks[:, WRIST]),
        )
    return torch.cat([aligned, wrist_relative.mean(dim=-1, keepdim=True)], dim=-1)


def vertex_scores(ground_truth: HandPoints, prediction: HandPoints) -> Float[Tensor, "hand score"]:
    """The columns of `VERTEX_SCORES`.

    Named as in `landmark_scores`; the vertices are aligned by themselves. E_RV is relative to the
    wrist landmark, neither turned nor scaled.

    Raises:
        ValueError: Vertices are absent, or do not correspond.
    """
    _check_vertices(ground_truth, prediction)
    chunks = zip(_chunks(ground_truth.double()), _chunks(prediction.double()), strict=True)
    with _full_precision():
        return torch.cat([_vertex_scores(*chunk) for chunk in chunks])


def _full_precision() -> torch.autocast:
    """A trainer's mixed precision must not reach the scores: its matrix products have three digits."""
    return torch.autocast("cpu", enabled=False)


def _vertex_scores(ground_truth: HandPoints, prediction: HandPoints) -> Tensor:
    surface, predicted_surface = _surface(ground_truth), _surface(prediction)
    aligned = _aligned_scores(surface, predicted_surface, _errors_area_and_agreement)
    wrist_relative = point_errors(
        root_relative(surface, ground_truth.landmarks[:, WRIST]),
        root_relative(predicted_surface, prediction.landmarks[:, WRIST]),
    )
    return torch.cat([aligned, wrist_relative.mean(dim=-1, keepdim=True)], dim=-1)


def _aligned_scores(
    ground_truth: Tensor, prediction: Tensor, score: Callable[[Tensor, Tensor], Tensor]
) -> Tensor:
    """One kind of scores after the official alignment, the proper one and none, side by side."""
    official = fit_similarity(ground_truth, prediction, reflections=True)
    official_scores = score(ground_truth, official.apply(prediction))
    # The two fits are one where the official one is no reflection: nearly everywhere.
    proper_scores = official_scores.clone()
    mirrored = official.mirrors
    if mirrored.any():
        proper = fit_similarity(ground_truth[mirrored], prediction[mirrored], reflections=False)
        proper_scores[mirrored] = score(ground_truth[mirrored], proper.apply(prediction[mirrored]))
    return torch.cat([official_scores, proper_scores, score(ground_truth, prediction)], dim=-1)


def _errors_and_area(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    errors = point_errors(ground_truth, prediction)
    return torch.stack([errors.mean(dim=-1), auc(errors)], dim=-1)


def _errors_area_and_agreement(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    return torch.cat(
        [_errors_and_area(ground_truth, prediction), f_score(ground_truth, prediction)], dim=-1
    )


def _surface(points: HandPoints) -> Tensor:
    if points.vertices is None:
        raise ValueError("Cannot score a surface without vertices; score the landmarks alone.")
    return points.vertices


def _chunks(points: HandPoints) -> list[HandPoints]:
    return [points[start : start + CHUNK] for start in range(0, max(len(points), 1), CHUNK)]


def _check_vertices(ground_truth: HandPoints, prediction: HandPoints) -> None:
    found, expected = _surface(prediction).shape[1], _surface(ground_truth).shape[1]
    if found != expected:
        raise ValueError(
            f"The prediction has {found} vertices and the ground truth {expected}, so that they do "
            "not correspond. Evaluate with the hand model that the ground truth was made with "
            "(hand=mano for MANO's 778 vertices), or without ground-truth vertices."
        )
