"""Lint: no mistake is reported for noise, mean poses, root-relative or shrunken hands."""

import pytest

from hand_recon.hand.model import HandModel
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.lint.lint import lint
from tests.support.bad_predictions import BAD_BUT_RIGHT
from tests.support.predicted_hands import mistakes, noisy, true_hands

FREIHAND, HO3D, DEXYCB = (PROTOCOLS[name] for name in ("freihand", "ho3d_v3", "dexycb"))

COUNT = 40


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
