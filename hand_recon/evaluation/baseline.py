"""The mean training hand as a constant prediction, the baseline of every aligned score.

Alignment removes most of a hand's variation, so that an aligned error is low even for one constant hand;
a method has learnt something only below this baseline.
"""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import Similarity, fit_similarity
from hand_recon.evaluation.scores import HandPoints

CONVERGED: Final = 1e-10
"""Relative change of the mean below which the iteration ends."""

MAXIMUM_ROUNDS: Final = 100
"""Most iterations; hands converge in about ten."""


def procrustes_mean(points: Float[Tensor, "hand point 3"]) -> Float[Tensor, "point 3"]:
    """Generalised Procrustes mean of the hands' shapes (Gower 1975).

    Every hand is centred, scaled to unit size and rotated onto the mean, without reflection, until
    the mean converges. It is returned centred, with the hands' mean size and the first hand's
    orientation, in double precision.

    Args:
        points: Corresponding points of at least one hand, metres.

    Raises:
        ValueError: There is no hand, or a hand has a NaN or all its points are equal.
    """
    normalised, sizes = _normalised(points.double())
    mean = normalised[0]
    for _ in range(MAXIMUM_ROUNDS):
        previous = mean
        mean = _rotated_onto(normalised, mean).mean(dim=0)
        mean = mean / torch.linalg.matrix_norm(mean)
        if torch.linalg.matrix_norm(mean - previous) < CONVERGED:
            break
    # The mean may rotate from round to round; the first hand fixes its orientation.
    mean = _rotated_onto(mean[None], normalised[0])[0]
    return mean * sizes.mean()


def mean_pose_baseline(hands: HandPoints) -> HandPoints:
    """Mean hand of a training set, to be scored against each hand of a test set.

    The vertices are averaged after the landmarks' alignment, so that both are of one hand and the
    landmarks are the same with and without vertices. Its orientation is arbitrary: only its aligned
    scores have a meaning.

    Args:
        hands: Ground truth of a training set, metres.

    Returns:
        One hand, as a batch of one.

    Raises:
        ValueError: There is no hand, or a hand has a NaN or all its points are equal.
    """
    hands = hands.double()
    mean = procrustes_mean(hands.landmarks)
    if hands.vertices is None:
        return HandPoints(landmarks=mean[None])
    fit = _rigid_fit(hands.landmarks, mean)
    # Averaging shrinks the mesh: rescale it by the factor that gives the landmarks the mean size.
    shrunk = torch.linalg.matrix_norm(fit.apply(hands.landmarks).mean(dim=0))
    growth = torch.linalg.matrix_norm(mean) / shrunk
    return HandPoints(mean[None], vertices=growth * fit.apply(hands.vertices).mean(dim=0)[None])


def _rigid_fit(points: Tensor, mean: Tensor) -> Similarity:
    """Rotation onto the mean, scaled to its size: a least-squares scale would shrink hands that fit badly."""
    fit = fit_similarity(mean.expand_as(points), points, reflections=False)
    sizes = torch.linalg.matrix_norm(points - points.mean(dim=-2, keepdim=True))
    scale = torch.linalg.matrix_norm(mean - mean.mean(dim=-2)) / sizes
    return Similarity(fit.rotation, scale, fit.source, fit.target)


def _rotated_onto(points: Tensor, mean: Tensor) -> Tensor:
    return _rigid_fit(points, mean).apply(points)


def _normalised(points: Tensor) -> tuple[Tensor, Tensor]:
    centred = points - points.mean(dim=-2, keepdim=True)
    sizes = torch.linalg.matrix_norm(centred)
    if not len(sizes) or not bool((sizes > 0).all()):
        raise ValueError(
            f"{int((~(sizes > 0)).sum())} of {len(sizes)} hands have no extent or a NaN; the mean "
            "needs at least one hand, and ground truth of each. Leave out samples without ground truth."
        )
    return centred / sizes[:, None, None], sizes
