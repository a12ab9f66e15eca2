"""A bad method is not a mistake: no alarm for noise, mean poses, root-relative or shrunken hands."""

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


def mean_pose(truth: HandPoints) -> HandPoints:
    mean = mean_pose_baseline(truth)
    assert mean.vertices is not None
    count = len(truth)
    return HandPoints(
        mean.landmarks.expand(count, -1, -1).clone(), mean.vertices.expand(count, -1, -1).clone()
    )


def turned_mean_pose(truth: HandPoints) -> HandPoints:
    """The mean pose where each hand is, turned as it is: a method that sees the view alone."""
    mean = mean_pose(truth)
    fit = fit_similarity(truth.landmarks, mean.landmarks, reflections=False)
    return changed(mean, fit.apply)


def halfway(truth: HandPoints) -> HandPoints:
    mean = turned_mean_pose(truth)
    return HandPoints((truth.landmarks + mean.landmarks) / 2)


def root_relative(truth: HandPoints) -> HandPoints:
    wrist = truth.landmarks[:, :1]
    return noisy(changed(truth, lambda points: points - wrist), 0.005)


BAD_BUT_RIGHT: dict[str, Callable[[HandPoints], HandPoints]] = {
    "perfect": lambda truth: truth,
    "5 mm": lambda truth: noisy(truth, 0.005),
    "20 mm": lambda truth: noisy(truth, 0.02),
    "40 mm": lambda truth: noisy(truth, 0.04),
    "mean pose": mean_pose,
    "mean pose before the camera": lambda truth: changed(mean_pose(truth), lambda points: points + 0.5),
    "turned mean pose": turned_mean_pose,
    "halfway to the mean": halfway,
    "root-relative": root_relative,
    "no extent": lambda truth: changed(truth, torch.zeros_like),
    "a canonical turn": lambda truth: changed(
        truth, fit_similarity(truth.landmarks[:1].expand_as(truth.landmarks), truth.landmarks,
                              reflections=False).apply,
    ),
    "a fifth too small": lambda truth: changed(truth, lambda points: 0.8 * points),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_BUT_RIGHT)
@pytest.mark.parametrize("count", [2, 12, 60])
def test_a_file_without_mistakes_raises_no_alarm_however_bad_it_is(
    hand: HandModel, name: str, count: int
) -> None:
    for seed, protocol in enumerate((FREIHAND, HO3D, DEXYCB, FREIHAND)):
        truth = true_hands(hand, count, seed)
        file = protocol.from_internal(BAD_BUT_RIGHT[name](truth))
        assert mistakes(lint(protocol.from_internal(truth), file, protocol)) == []


@pytest.mark.parametrize(
    ("name", "kind"),
    [("mean pose", "constant"), ("root-relative", "root_relative"), ("no extent", "no_extent")],
)
def test_what_limits_the_scores_is_noted(hand: HandModel, name: str, kind: str) -> None:
    truth = true_hands(hand, COUNT)
    findings = lint(truth, BAD_BUT_RIGHT[name](truth), FREIHAND)
    assert kind in [finding.kind for finding in findings]
    assert all(finding.score_if_mended is None for finding in findings)


def test_good_predictions_are_not_noted_at_all(hand: HandModel) -> None:
    truth = true_hands(hand, COUNT)
    assert lint(truth, noisy(truth, 0.005), FREIHAND) == ()
