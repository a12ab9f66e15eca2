"""Scores of FreiHAND's script by definition, one frame and one point at a time (Sec. 4.1)."""

import numpy as np
from jaxtyping import Float
from scipy.linalg import orthogonal_procrustes
from scipy.spatial import cKDTree

THRESHOLDS = (5, 15)
"""Thresholds of the F-scores, millimetres."""


def align_official(
    ground_truth: Float[np.ndarray, "point 3"], prediction: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "point 3"]:
    """Procrustes alignment of one hand as the benchmarks' scripts do it, by SciPy.

    Args:
        ground_truth: Any unit.
        prediction: The same points in the same unit.
    """
    centre, other_centre = ground_truth.mean(axis=0), prediction.mean(axis=0)
    norm = np.linalg.norm(ground_truth - centre) + 1e-8
    other_norm = np.linalg.norm(prediction - other_centre) + 1e-8
    normalised = (prediction - other_centre) / other_norm
    rotation, scale = orthogonal_procrustes((ground_truth - centre) / norm, normalised)
    aligned: np.ndarray = normalised @ rotation.T * scale * norm + centre
    return aligned


def auc(errors: Float[np.ndarray, "frame point"], limit: float = 0.05) -> float:
    """Area under each point's PCK curve over all frames, averaged over the points.

    Args:
        errors: Distances.
        limit: Largest threshold, in the errors' unit.
    """
    thresholds = np.linspace(0.0, limit, 100)
    areas = []
    for of_point in errors.T:
        shares = [np.mean(of_point <= threshold) for threshold in thresholds]
        areas.append(np.trapezoid(shares, thresholds) / limit)
    return float(np.mean(areas))


def f_score(
    ground_truth: Float[np.ndarray, "point 3"],
    prediction: Float[np.ndarray, "other_point 3"],
    threshold: float,
) -> float:
    """Harmonic mean of the shares of points with a strictly nearer one in the other cloud, by k-d trees.

    Args:
        ground_truth: Points of one hand.
        prediction: Points of another.
        threshold: Distance, in the points' unit.
    """
    recall = np.mean(cKDTree(prediction).query(ground_truth)[0] < threshold)
    precision = np.mean(cKDTree(ground_truth).query(prediction)[0] < threshold)
    total = recall + precision
    return float(2 * recall * precision / total) if total else 0.0


def freihand_scores(
    ground_truth: dict[str, Float[np.ndarray, "frame _ 3"]],
    prediction: dict[str, Float[np.ndarray, "frame _ 3"]],
) -> dict[str, float]:
    """FreiHAND's scores by its names: `mean3d` in centimetres, the others 0 to 1.

    Args:
        ground_truth: `xyz` and `mesh` of every frame, metres.
        prediction: The same.
    """
    errors: dict[str, list[list[float]]] = {}
    agreement: dict[str, list[float]] = {}
    for name, frames in ground_truth.items():
        for points, predicted in zip(frames, prediction[name], strict=True):
            for suffix, moved in {"": predicted, "_al": align_official(points, predicted)}.items():
                filed = errors.setdefault(name + suffix, [[] for _ in points])
                for of_point, one, other in zip(filed, points, moved, strict=True):
                    of_point.append(float(np.linalg.norm(one - other)))
                if name == "mesh":
                    for threshold in THRESHOLDS:
                        score = f_score(points, moved, threshold / 1000)
                        agreement.setdefault(f"f{suffix}_score_{threshold}", []).append(score)
    scores = {name: float(np.mean(values)) for name, values in agreement.items()}
    for name, values in errors.items():
        scores[f"{name}_mean3d"] = 100 * float(np.mean(values))
        scores[f"{name}_auc3d"] = auc(np.array(values).T)
    return scores
