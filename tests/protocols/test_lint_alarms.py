"""Lint: no mistake is reported for noise, mean poses, root-relative or shrunken hands."""

from collections.abc import Callable

import pytest
import torch

from hand_recon.evaluation.alignment import fit_similarity
from hand_recon.evaluation.baseline import mean_pose_baseline
from hand_recon.evaluation.scores import HandPoints
from hand_recon.hand.model import HandModel
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.lint.lint import lint
from tests.support.predicted_hands import changed, mistakes, noisy, true_hands

FREIHAND, HO3D, DEXYCB = (PROTOCOLS[name] for name in ("freihand", "ho3d_v3", "dexycb"))

COUNT = 40


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


@pytest.mark.parametrize("name", BAD_BUT_RIGHT)
@pytest.mark.parametrize("count", [2, 12, 60])
def test_a_file_without_mistakes_raises_no_alarm_however_bad_it_is(
    hand: HandModel, name: str, count: int
) -> None:
    for seed, protocol in enumerate((FREIHAND, HO3D, DEXYCB, FREIHAND)):
        ground_truth = true_hands(hand, count, seed)
        file = protocol.from_internal(BAD_BUT_RIGHT[name](ground_truth))
        assert mistakes(lint(protocol.from_internal(ground_truth), file, protocol)) == []


@pytest.mark.parametrize(
    ("name", "kind"),
    [("mean pose", "constant"), ("root-relative", "root_relative"), ("no extent", "no_extent")],
)
def test_what_limits_the_scores_is_noted(hand: HandModel, name: str, kind: str) -> None:
    ground_truth = true_hands(hand, COUNT)
    findings = lint(ground_truth, BAD_BUT_RIGHT[name](ground_truth), FREIHAND)
    assert kind in [finding.kind for finding in findings]
    assert all(finding.score_if_mended is None for finding in findings)


def test_good_predictions_are_not_noted_at_all(hand: HandModel) -> None:
    ground_truth = true_hands(hand, COUNT)
    assert lint(ground_truth, noisy(ground_truth, 0.005), FREIHAND) == ()
