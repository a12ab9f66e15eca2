"""Plausibility: natural hands pass, unnatural ones are detected, and each hand counts once."""

import copy
import math

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from hand_recon.data.synthetic.gestures import gesture_library, sample_pose
from hand_recon.data.synthetic.unnatural import KINDS, sample_unnatural_pose
from hand_recon.evaluation.plausibility import (
    ROM_TOLERANCE,
    Plausibility,
    range_violation,
)
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.range_of_motion import range_of_motion_loss
from hand_recon.knowledge.ranges import RangeOfMotion, load_ranges
from tests.support.tolerance import BATCH_SHAPES, assert_close

TABLES = ["literature", "paper_release"]
VERTICES = torch.zeros(4, 5, 3)


class FakePenetration(nn.Module):
    """Penetration whose depth is the vertex's first coordinate."""

    def __init__(self) -> None:
        super().__init__()
        self.tolerance = 0.006

    def depths(self, vertices: Tensor) -> Tensor:
        return vertices[..., 0].clamp(min=0)


@pytest.fixture(scope="module")
def ranges() -> RangeOfMotion:
    """Bounds of −20° to 60° for every axis."""
    bound = torch.ones(15, 3).deg2rad()
    return RangeOfMotion(-20 * bound, 60 * bound)


def hands(*degrees: float) -> Tensor:
    """One hand per number, the bend of its ring PIP in degrees; all other angles are zero."""
    angles = torch.zeros(len(degrees), 15, 3)
    angles[:, 10, 0] = torch.tensor(degrees).deg2rad()
    return angles


def test_the_largest_violation_counts_and_the_inside_counts_nothing(ranges: RangeOfMotion) -> None:
    angles = hands(70, -25, 30, 60)
    angles[0, 3, 1] = math.radians(-50)  # 30 degrees below; the PIP is 10 above.
    found = range_violation(angles, ranges).rad2deg()
    assert_close(found, torch.tensor([30.0, 5.0, 0.0, 0.0]))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_the_largest_of_45_differences(
    ranges: RangeOfMotion, shape: tuple[int, ...]
) -> None:
    angles = torch.randn(*shape, 15, 3)
    expected = [
        max(
            max(float(hand[j, a] - ranges.upper[j, a]), float(ranges.lower[j, a] - hand[j, a]), 0.0)
            for j in range(15)
            for a in range(3)
        )
        for hand in angles.reshape(-1, 15, 3)
    ]
    assert_close(range_violation(angles, ranges), torch.tensor(expected).view(shape))


def test_a_hand_has_no_violation_exactly_when_it_has_no_pose_loss(ranges: RangeOfMotion) -> None:
    angles = 0.6 * torch.randn(200, 15, 3)
    angles[:100] = ranges.clamp(angles[:100])
    free = range_violation(angles, ranges) == 0
    assert 100 <= int(free.sum()) < 200
    assert torch.equal(free, range_of_motion_loss(angles, ranges) == 0)


def test_the_tolerance_is_two_standard_deviations_of_the_sixteen_that_latz_published() -> None:
    flexion, extension = (8.6, 8.5, 11.5, 8.6), (10.2, 10.1, 11.6, 16.8)
    radial, ulnar = (11.3, 11.1, 5.8, 12.9), (12.8, 8.9, 12.4, 18.7)
    mean = np.mean([flexion, extension, radial, ulnar])
    assert math.degrees(ROM_TOLERANCE) == pytest.approx(2 * mean, abs=0.1)


def test_scores_are_percentages_of_hands_and_a_mean_in_degrees(ranges: RangeOfMotion) -> None:
    """Violations of 0, 10, 22 and 24 degrees: one is beyond two standard deviations."""
    vertices = VERTICES.clone()
    vertices[:, 2, 0] = torch.tensor([-1.0, 0.005, 0.007, 0.02])
    metric = Plausibility(ranges, FakePenetration())
    metric.update(hands(60, 70, 82, 84), vertices, torch.arange(4))
    expected = {"PR": 50.0, "ROM": 25.0, "ROM_degrees": 14.0}
    assert metric.compute() == pytest.approx(expected, rel=1e-5)


def test_without_a_measure_of_depth_there_is_no_penetration_rate(ranges: RangeOfMotion) -> None:
    metric = Plausibility(ranges)
    metric.update(hands(0, 0, 0, 90), VERTICES, torch.arange(4))
    assert metric.compute() == pytest.approx({"ROM": 25.0, "ROM_degrees": 7.5}, rel=1e-5)


def test_the_loss_of_eq_4_measures_the_depths(hand: HandModel, ranges: RangeOfMotion) -> None:
    """One of three hands has its joints turned about every axis, and penetrates itself."""
    angles = torch.stack([torch.zeros(15, 3), torch.randn(15, 3), torch.zeros(15, 3)])
    metric = Plausibility(ranges, NonPenetration(hand))
    metric.update(angles, hand(angles, torch.zeros(3, 10)).vertices, torch.arange(3))
    assert metric.compute()["PR"] == pytest.approx(100 / 3)


def test_a_hand_that_comes_twice_counts_once_and_batches_do_not_matter(
    ranges: RangeOfMotion,
) -> None:
    angles, index = hands(0, 90, 90, 70), torch.tensor([0, 7, 7, 3])
    whole, parts = Plausibility(ranges), Plausibility(ranges)
    whole.update(angles, VERTICES, index)
    for i in range(4):
        parts.update(angles[i : i + 1], VERTICES[i : i + 1], index[i : i + 1])
    expected = {"ROM": 100 / 3, "ROM_degrees": 40 / 3}
    assert whole.compute() == pytest.approx(expected, rel=1e-5)
    assert parts.compute() == pytest.approx(expected, rel=1e-5)


def test_it_can_be_reset_and_copied(ranges: RangeOfMotion) -> None:
    metric = Plausibility(ranges, FakePenetration())
    metric.update(hands(90), VERTICES[:1], torch.arange(1))
    other = copy.deepcopy(metric)
    metric.reset()
    metric.update(hands(0), VERTICES[:1], torch.arange(1))
    assert metric.compute()["ROM"] == 0.0
    assert other.compute()["ROM"] == 100.0


def test_without_samples_there_are_no_scores(ranges: RangeOfMotion) -> None:
    metric = Plausibility(ranges, FakePenetration())
    metric.update(hands(), VERTICES[:0], torch.arange(0))
    assert metric.compute() == {}


def test_predictions_that_are_not_finite_name_their_samples(ranges: RangeOfMotion) -> None:
    index = torch.arange(4) + 5
    angles = hands(0, 0, math.nan, 0)
    with pytest.raises(ValueError, match="joint angles of the samples 7 are not finite"):
        Plausibility(ranges).update(angles, VERTICES, index)
    broken, metric = torch.full_like(VERTICES, math.inf), Plausibility(ranges, FakePenetration())
    with pytest.raises(ValueError, match="vertices of the samples 5, 6, 7, 8 are not finite"):
        metric.update(hands(0, 0, 0, 0), broken, index)


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("held_out", [False, True])
def test_no_natural_hand_violates_a_range(table: str, held_out: bool) -> None:
    random = np.random.default_rng(0)
    poses = [sample_pose(random, held_out=held_out) for _ in range(1000)]
    poses += [gesture.joint_angles for gesture in gesture_library()]
    angles = torch.from_numpy(np.stack(poses)).float()
    metric = Plausibility(load_ranges(table))
    metric.update(angles, torch.zeros(len(angles), 1, 3), torch.arange(len(angles)))
    scores = metric.compute()
    assert scores["ROM"] == 0.0
    assert scores["ROM_degrees"] < 5


@pytest.mark.parametrize(
    ("kind", "least"),
    [
        ("hyper_bent", 99),
        ("over_bent", 99),
        ("twisted", 99),
        ("sideways", 99),
        (
            "penetrating",
            50,
        ),  # A matter of PR: a finger may pass another with every joint in its range.
    ],
)
def test_unnatural_hands_are_caught(kind: str, least: float) -> None:
    random = np.random.default_rng(1)
    poses = [sample_unnatural_pose(random, kind).joint_angles for _ in range(300)]
    angles = torch.from_numpy(np.stack(poses)).float()
    caught = range_violation(angles, load_ranges("literature")) > ROM_TOLERANCE
    assert 100 * float(caught.double().mean()) >= least


def test_every_kind_of_unnatural_hand_has_its_rate_above() -> None:
    marks = test_unnatural_hands_are_caught.pytestmark  # type: ignore[attr-defined]
    assert {kind for kind, _ in marks[0].args[1]} == set(KINDS)
