"""The metrics by definition in NumPy and SciPy, one hand and one point at a time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hand_recon.speed.published.scores_by_definition import auc

Array = NDArray[np.float64]


def align_proper(truth: Array, prediction: Array) -> Array:
    """The best rotation, scale and translation of one hand: Umeyama's formula, no offset."""
    truth_centre, prediction_centre = truth.mean(axis=0), prediction.mean(axis=0)
    centred = prediction - prediction_centre
    left, stretches, right = np.linalg.svd((truth - truth_centre).T @ centred)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    scale = (stretches * signs).sum() / (centred**2).sum()
    aligned: Array = scale * centred @ (left @ np.diag(signs) @ right).T + truth_centre
    return aligned


def f_score(truth: Array, prediction: Array, threshold: float) -> float:
    """Harmonic mean of the shares of points with a strictly nearer one in the other cloud."""
    distances = np.linalg.norm(truth[:, None] - prediction[None], axis=-1)
    recall = np.mean(distances.min(axis=1) < threshold)
    precision = np.mean(distances.min(axis=0) < threshold)
    if recall + precision == 0:
        return 0.0
    return float(2 * recall * precision / (recall + precision))


def point_scores(truth: Sequence[Array], prediction: Sequence[Array]) -> tuple[float, float]:
    """Mean distance and AUC of points, in metres, over frames."""
    errors = np.array(
        [np.linalg.norm(t - p, axis=-1) for t, p in zip(truth, prediction, strict=True)]
    )
    return float(errors.mean()), auc(errors)
