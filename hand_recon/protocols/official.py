"""Scores of the benchmarks' own scripts, under their names and in their units (Sec. 4.1).

Checked to the last printed digit against the scripts' output on a small set of arrays.
"""

from typing import Final

import torch
from torch import Tensor

from hand_recon.evaluation.alignment import (
    WRIST,
    align_official,
    align_scale_translation,
    root_relative,
)
from hand_recon.evaluation.point_error import auc, point_errors
from hand_recon.evaluation.scores import (
    LANDMARK_SCORES,
    VERTEX_SCORES,
    HandPoints,
    landmark_scores,
    vertex_scores,
)

CENTIMETRES: Final = 100.0
"""Centimetres per metre: FreiHAND's and HO3D's scripts write centimetres."""

MILLIMETRES: Final = 1000.0
"""Millimetres per metre: DexYCB's toolkit computes in millimetres."""

_SURFACE_NAMES: Final = {
    "mesh_mean3d": "E_V_unaligned",
    "mesh_auc3d": "AUC_V_unaligned",
    "mesh_al_mean3d": "E_V",
    "mesh_al_auc3d": "AUC_V",
    "f_score_5": "F@5_unaligned",
    "f_al_score_5": "F@5",
    "f_score_15": "F@15_unaligned",
    "f_al_score_15": "F@15",
}

_FREIHAND_LANDMARK_NAMES: Final = {
    "xyz_mean3d": "E_J_unaligned",
    "xyz_auc3d": "AUC_J_unaligned",
    "xyz_al_mean3d": "E_J",
    "xyz_al_auc3d": "AUC_J",
}

_HO3D_LANDMARK_NAMES: Final = {
    "xyz_mean3d": "E_J_unaligned",
    "xyz_auc3d": "AUC_J_unaligned",
    "xyz_procrustes_al_mean3d": "E_J",
    "xyz_procrustes_al_auc3d": "AUC_J",
}


def freihand_scores(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, float]:
    """Scores in `scores.txt` of FreiHAND's `eval.py`.

    Args:
        ground_truth: Landmarks and vertices, camera frame, metres.
        prediction: Predicted landmarks and as many vertices, in the same frame, metres.

    Returns:
        `mean3d` in centimetres, the others 0 to 1.

    Raises:
        ValueError: Vertices are absent, or their numbers differ.
    """
    return _renamed(
        _FREIHAND_LANDMARK_NAMES | _SURFACE_NAMES, _mean_scores(ground_truth, prediction)
    )


def ho3d_scores(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, float]:
    """Scores in `scores.txt` of HO3D's `eval.py`.

    Args:
        ground_truth: Landmarks *in FreiHAND's order* and vertices, metres. The scores are the same in HO3D's
            order and axes.
        prediction: Predicted landmarks and as many vertices, in the same frame, metres.

    Returns:
        `mean3d` in centimetres, the others 0 to 1.

    Raises:
        ValueError: Vertices are absent, or their numbers differ.
    """
    scores = _renamed(_HO3D_LANDMARK_NAMES | _SURFACE_NAMES, _mean_scores(ground_truth, prediction))
    landmarks, predicted = _landmarks(ground_truth), _landmarks(prediction)
    aligned = align_scale_translation(landmarks, predicted)
    errors = point_errors(landmarks, aligned)
    return scores | {
        "xyz_scale_trans_al_mean3d": float(errors.mean()) * CENTIMETRES,
        "xyz_scale_trans_al_auc3d": float(auc(errors).mean()),
    }


def dexycb_scores(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, dict[str, float]]:
    """Scores of the hand pose evaluation of DexYCB's toolkit: landmarks only, three alignments.

    Returns:
        `mpjpe_mm` in millimetres and `auc` from 0 to 1, for each alignment.
    """
    # In millimetres from the start, as the toolkit: a zero error in metres may not be zero in millimetres.
    landmarks = _landmarks(ground_truth) * MILLIMETRES
    predicted = _landmarks(prediction) * MILLIMETRES
    pairs = {
        "absolute": (landmarks, predicted),
        "root-relative": (
            root_relative(landmarks, landmarks[:, WRIST]),
            root_relative(predicted, predicted[:, WRIST]),
        ),
        "procrustes": (landmarks, align_official(landmarks, predicted)),
    }
    return {name: _millimetre_scores(*pair) for name, pair in pairs.items()}


def _landmarks(points: HandPoints) -> Tensor:
    # Without the vertices: those of a test set take gigabytes in double precision.
    return HandPoints(points.landmarks).double().landmarks


def _millimetre_scores(ground_truth: Tensor, prediction: Tensor) -> dict[str, float]:
    errors = point_errors(ground_truth, prediction)
    return {"mpjpe_mm": float(errors.mean()), "auc": float(auc(errors, limit=50.0).mean())}


def _mean_scores(ground_truth: HandPoints, prediction: HandPoints) -> dict[str, float]:
    rows = torch.cat(
        [landmark_scores(ground_truth, prediction), vertex_scores(ground_truth, prediction)], dim=-1
    )
    return dict(zip(LANDMARK_SCORES + VERTEX_SCORES, rows.mean(dim=0).tolist(), strict=True))


def _renamed(names: dict[str, str], scores: dict[str, float]) -> dict[str, float]:
    return {
        official: scores[ours] * (CENTIMETRES if official.endswith("mean3d") else 1.0)
        for official, ours in names.items()
    }
