"""3D scores of single hands: errors, areas under the PCK curve, F-scores (Sec. 4.1).

Computed in double precision on the CPU, so that the numbers are the official ones on any device.
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
"""Columns of `landmark_scores`. Errors in metres, areas 0 to 1."""

VERTEX_SCORES: Final = (
    "E_V", "AUC_V", "F@5", "F@15",
    "E_V_proper", "AUC_V_proper", "F@5_proper", "F@15_proper",
    "E_V_unaligned", "AUC_V_unaligned", "F@5_unaligned", "F@15_unaligned",
    "E_RV",
)  # fmt: skip
"""Columns of `vertex_scores`. Errors in metres, areas and F-scores 0 to 1."""

CHUNK: Final = 64
"""Hands scored together, few enough for the cache."""


@dataclass(frozen=True)
class HandPoints:
    """Landmarks and vertices of hands to be scored."""

    landmarks: Float[Tensor, "hand landmark=21 3"]
    """In the order of `hand_recon.hand.skeleton.LANDMARKS`, metres."""
    vertices: Float[Tensor, "hand vertex 3"] | None = None
    """In the landmarks' frame, metres; absent where a dataset has no surface."""

    def __len__(self) -> int:
        return len(self.landmarks)

    def __getitem__(self, hands: Tensor | slice) -> Self:
        """Select hands."""
        vertices = None if self.vertices is None else self.vertices[hands]
        return type(self)(landmarks=self.landmarks[hands], vertices=vertices)

    def double(self) -> Self:
        """Detach the points, in double precision on the CPU."""
        # First to the CPU: not every accelerator knows double precision.
        vertices = None if self.vertices is None else self.vertices.detach().cpu().double()
        return type(self)(landmarks=self.landmarks.detach().cpu().double(), vertices=vertices)


def landmark_scores(
    ground_truth: HandPoints, prediction: HandPoints
) -> Float[Tensor, "hand score"]:
    """Scores of the landmarks of each hand, the columns of `LANDMARK_SCORES`.

    E_J (PA-MPJPE) and AUC_J follow the official alignment, `_proper` ones an alignment without
    reflections, `_unaligned` ones none. MPJPE is relative to the wrist, neither rotated nor scaled, as
    DexYCB's root-relative error.
    """
    # Without the vertices: those of a test set take gigabytes in double precision.
    ground_truth, prediction = (
        HandPoints(points.landmarks).double() for points in (ground_truth, prediction)
    )
    with _full_precision():
        aligned = _aligned_scores(ground_truth.landmarks, prediction.landmarks, _errors_and_area)
        wrist_relative = point_errors(
            root_relative(ground_truth.landmarks, ground_truth.landmarks[:, WRIST]),
            root_relative(prediction.landmarks, prediction.landmarks[:, WRIST]),
        )
    return torch.cat([aligned, wrist_relative.mean(dim=-1, keepdim=True)], dim=-1)


def vertex_scores(ground_truth: HandPoints, prediction: HandPoints) -> Float[Tensor, "hand score"]:
    """Scores of the vertices of each hand, the columns of `VERTEX_SCORES`.

    Named as in `landmark_scores`; E_V is PA-MPVPE. The vertices are aligned without the landmarks. E_RV
    is relative to the wrist landmark, neither rotated nor scaled.

    Raises:
        ValueError: Vertices are absent, or their numbers differ.
    """
    _check_vertices(ground_truth, prediction)
    chunks = zip(_chunks(ground_truth), _chunks(prediction), strict=True)
    with _full_precision():
        return torch.cat([_vertex_scores(one.double(), other.double()) for one, other in chunks])


def _full_precision() -> torch.autocast:
    """Context without mixed precision, whose matrix products have only three digits."""
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
    """Scores after the official alignment, after the one without reflections, and without alignment."""
    official = fit_similarity(ground_truth, prediction, reflections=True)
    official_scores = score(ground_truth, official.apply(prediction))
    # The two alignments differ only where the official one is a reflection, which is rare.
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
        raise ValueError(
            "Vertex scores were asked for, but there are points without vertices; score the landmarks alone."
        )
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
