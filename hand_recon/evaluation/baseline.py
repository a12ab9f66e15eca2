"""The mean hand as a constant prediction: what any method must beat.

An aligned error says little by itself, because alignment hides most of a hand's variation. The mean
of all hands, predicted for every picture, shows where learning anything begins.
"""

from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import Similarity, fit_similarity
from hand_recon.evaluation.scores import HandPoints

CONVERGED: Final = 1e-10
"""Change of the mean, over its size, at which the iteration ends."""

MAXIMUM_ROUNDS: Final = 100
"""Rounds after which the iteration ends in any case; hands take about ten."""


def procrustes_mean(points: Float[Tensor, "hand point 3"]) -> Float[Tensor, "point 3"]:
    """Generalised Procrustes mean (Gower 1975): of the hands' form, whatever their pose in space.

    Every hand is centred, scaled to unit size and turned onto the mean, without reflection, until
    the mean rests. It is returned with the hands' mean size, centred, in double precision, and
    turned as the first hand.

    Args:
        points: Corresponding points of at least one hand, metres.

    Raises:
        ValueError: There is no hand, or a hand has no extent or a NaN.
    """
    normalised, sizes = _normalised(points.double())
    mean = normalised[0]
    for _ in range(MAXIMUM_ROUNDS):
        previous = mean
        mean = _turned(normalised, mean).mean(dim=0)
        mean = mean / torch.linalg.matrix_norm(mean)
        if torch.linalg.matrix_norm(mean - previous) < CONVERGED:
            break
    # Over the rounds the mean may drift round; the first hand says how it was turned.
    mean = _turned(mean[None], normalised[0])[0]
    return mean * sizes.mean()


def mean_pose_baseline(hands: HandPoints) -> HandPoints:
    """The mean hand, to be scored against each hand of a test set.

    The vertices are averaged where the landmarks' alignment puts them, so that both are one hand
    and the landmarks are the same with and without vertices. Its turn in space means nothing: of
    its scores only the aligned ones do.

    Args:
        hands: Ground truth of a training set, metres.

    Returns:
        One hand, as a batch of one.

    Raises:
        ValueError: There is no hand, or a hand has no extent or a NaN.
    """
    hands = hands.double()
    mean = procrustes_mean(hands.landmarks)
    if hands.vertices is None:
        return HandPoints(landmarks=mean[None])
    fit = _rigid_fit(hands.landmarks, mean)
    # What does not fit averages out and leaves a smaller hand; the landmarks were made up for it.
    shrunk = torch.linalg.matrix_norm(fit.apply(hands.landmarks).mean(dim=0))
    growth = torch.linalg.matrix_norm(mean) / shrunk
    return HandPoints(mean[None], vertices=growth * fit.apply(hands.vertices).mean(dim=0)[None])


def _rigid_fit(points: Tensor, mean: Tensor) -> Similarity:
    """Turn onto the mean, at the mean's size: an estimate of scale would shrink what fits badly."""
    fit = fit_similarity(mean.expand_as(points), points, reflections=False)
    sizes = torch.linalg.matrix_norm(points - points.mean(dim=-2, keepdim=True))
    scale = torch.linalg.matrix_norm(mean - mean.mean(dim=-2)) / sizes
    return Similarity(fit.rotation, scale, fit.source, fit.target)


def _turned(points: Tensor, mean: Tensor) -> Tensor:
    return _rigid_fit(points, mean).apply(points)


def _normalised(points: Tensor) -> tuple[Tensor, Tensor]:
    centred = points - points.mean(dim=-2, keepdim=True)
    sizes = torch.linalg.matrix_norm(centred)
    if not len(sizes) or not bool((sizes > 0).all()):
        raise ValueError(
            f"{int((~(sizes > 0)).sum())} of {len(sizes)} hands have no extent or a NaN; the mean "
            "needs at least one hand, and each with its ground truth. Leave out samples without."
        )
    return centred / sizes[:, None, None], sizes
