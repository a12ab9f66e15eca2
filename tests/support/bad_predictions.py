"""Predictions with large errors and without mistakes, as of weak methods."""

from collections.abc import Callable

import torch

from hand_recon.evaluation.alignment import fit_similarity
from hand_recon.evaluation.baseline import mean_pose_baseline
from hand_recon.evaluation.scores import HandPoints
from tests.support.predicted_hands import changed, noisy


def mean_pose(ground_truth: HandPoints) -> HandPoints:
    mean = mean_pose_baseline(ground_truth)
    assert mean.vertices is not None
    count = len(ground_truth)
    return HandPoints(
        mean.landmarks.expand(count, -1, -1).clone(), mean.vertices.expand(count, -1, -1).clone()
    )


def oriented_mean_pose(ground_truth: HandPoints) -> HandPoints:
    """The mean pose with each hand's position and orientation, as of a method that only sees the view."""
    mean = mean_pose(ground_truth)
    fit = fit_similarity(ground_truth.landmarks, mean.landmarks, reflections=False)
    return changed(mean, fit.apply)


def halfway(ground_truth: HandPoints) -> HandPoints:
    mean = oriented_mean_pose(ground_truth)
    return HandPoints((ground_truth.landmarks + mean.landmarks) / 2)


def root_relative(ground_truth: HandPoints) -> HandPoints:
    wrist = ground_truth.landmarks[:, :1]
    return noisy(changed(ground_truth, lambda points: points - wrist), 0.005)


BAD_BUT_RIGHT: dict[str, Callable[[HandPoints], HandPoints]] = {
    "perfect": lambda ground_truth: ground_truth,
    "5 mm": lambda ground_truth: noisy(ground_truth, 0.005),
    "20 mm": lambda ground_truth: noisy(ground_truth, 0.02),
    "40 mm": lambda ground_truth: noisy(ground_truth, 0.04),
    "mean pose": mean_pose,
    "mean pose in front of the camera": lambda hands: changed(mean_pose(hands), lambda points: points + 0.5),
    "oriented mean pose": oriented_mean_pose,
    "halfway to the mean": halfway,
    "root-relative": root_relative,
    "no extent": lambda ground_truth: changed(ground_truth, torch.zeros_like),
    "a canonical orientation": lambda hands: changed(
        hands, fit_similarity(hands.landmarks[:1].expand_as(hands.landmarks), hands.landmarks,
                              reflections=False).apply,
    ),
    "a fifth too small": lambda ground_truth: changed(ground_truth, lambda points: 0.8 * points),
}  # fmt: skip
