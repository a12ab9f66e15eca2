"""Learning from 2D landmarks: what is known without data, and offsets recovered from hands that have them."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.camera import project
from hand_recon.fitting.observation import observed
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED, LANDMARKS
from hand_recon.knowledge.ranges import load_ranges
from learn_from_landmarks import Learner, without_data
from tests.support.views import known_hands, views

HANDS = 48


def bend(name: str) -> int:
    """Place of a joint's bend among the 45 angles."""
    return 3 * ARTICULATED.index(name)


def test_without_data_an_uncoupled_angle_has_the_moments_of_its_range() -> None:
    known = without_data()
    ranges = load_ranges("literature", open_hand().rest_angles)
    place = bend("thumb MCP")
    lower, upper = float(ranges.lower.flatten()[place]), float(ranges.upper.flatten()[place])
    assert float(known.mean[place]) == pytest.approx((lower + upper) / 2, abs=1e-6)
    deviation = float(known.covariance[place, place].sqrt())
    assert deviation == pytest.approx((upper - lower) / math.sqrt(12), rel=1e-6)


def test_without_data_joints_of_a_finger_and_neighbours_bend_together() -> None:
    covariance = without_data().covariance
    deviation = covariance.diagonal().sqrt()
    correlation = covariance / deviation / deviation[:, None]
    assert correlation[bend("index PIP"), bend("index DIP")] > 0.3
    assert correlation[bend("ring MCP"), bend("little MCP")] > 0.1
    assert correlation[bend("thumb MCP"), bend("index MCP")].abs() < 1e-9


@pytest.fixture(scope="module")
def learner() -> Learner:
    """Learner of hands whose landmarks are not those of the model: the PIPs and the thumb's CMC are moved."""
    torch.manual_seed(3)
    hand = open_hand()
    known = known_hands(hand, HANDS)
    truth = Learner(observed(views(hand, known)))
    truth.offsets[LANDMARKS.index("thumb CMC")] = torch.tensor([0.0, -0.012, 0.0])
    truth.offsets[LANDMARKS.index("middle PIP")] = torch.tensor([0.0, -0.008, 0.0])
    moved = truth.hand().to_camera(known).landmarks
    seen = truth.observation
    return Learner(replace(seen, landmarks_2d=project(moved, seen.intrinsics)))


def test_offsets_of_the_landmarks_are_found(learner: Learner) -> None:
    """Five rounds find most of two offsets, and residuals fall from round to round."""
    residuals = [learner.learn_offsets() for _ in range(5)]
    assert residuals == sorted(residuals, reverse=True)
    found = learner.offsets
    assert -0.016 < float(found[LANDMARKS.index("thumb CMC"), 1]) < -0.006
    assert -0.011 < float(found[LANDMARKS.index("middle PIP"), 1]) < -0.003
    others = [place for place, name in enumerate(LANDMARKS) if name.endswith(("MCP", "tip"))]
    assert float(found[others].norm(dim=1).mean()) < 0.003


def test_statistics_are_those_of_the_poses(learner: Learner) -> None:
    learner.statistics = learner.before
    first, second = learner.learn_poses(), learner.learn_poses()
    assert second < first
    found = learner.statistics
    assert found is not None
    torch.testing.assert_close(found.covariance, found.covariance.mT)
    assert float(torch.linalg.eigvalsh(found.covariance).amin()) > 0
    free = ~learner.fixed
    assert float((found.mean - learner.before.mean)[free].abs().amax()) > math.radians(3)
