"""The nearest plausible hand."""

import math
from dataclasses import replace

import pytest
import torch

from hand_recon.data.synthetic.unnatural import KINDS
from hand_recon.fitting.hand_records import HandRecords
from hand_recon.fitting.hands_file import hand_entries
from hand_recon.fitting.hands_file import to_records as checked
from hand_recon.fitting.origin import Moment
from hand_recon.hand.model import HandModel
from hand_recon.plausibility.given_hands import of_points
from hand_recon.plausibility.repaired_hands import RepairedHands, repaired, to_records
from tests.support.audited_hands import (
    MIRROR,
    audit_of,
    bent,
    given_angles,
    models_of,
    natural_angles,
    points_of,
    unnatural_angles,
)


def repair_of(given: object, hand: HandModel) -> RepairedHands:
    return repaired(audit_of(given, hand), models_of(hand))  # type: ignore[arg-type]


def assert_none_left(found: RepairedHands) -> None:
    after = found.after.findings
    assert float(after.beyond_range.abs().max()) == 0.0
    assert float(after.beyond_anatomy.abs().max()) == 0.0
    assert float(after.depth.max()) < 6.0
    assert found.summary()["violating_percent_after"] == 0.0


@pytest.fixture(scope="module")
def unnatural(hand: HandModel) -> RepairedHands:
    """Three hands of each kind of error."""
    angles = torch.cat([unnatural_angles(kind, 3, seed=4) for kind in sorted(KINDS)])
    return repair_of(given_angles(angles), hand)


def test_no_violation_is_left(unnatural: RepairedHands) -> None:
    assert unnatural.summary()["violating_percent_before"] == 100.0
    assert unnatural.summary()["depth_mm_greatest_before"] > 8.0
    assert_none_left(unnatural)
    assert bool(unnatural.moved.isfinite().all())


def test_no_violation_is_left_in_hands_fitted_to_noisy_points_of_either_side(
    hand: HandModel,
) -> None:
    points = points_of(hand, natural_angles(12)) + 0.004 * torch.randn(12, 21, 3)
    points[::2] *= MIRROR
    found = repair_of(of_points(points, "points", left=[True, False] * 6), hand)
    assert_none_left(found)
    assert float(found.moved.mean()) < 8.0


def test_a_plausible_hand_stays_where_it_is(hand: HandModel) -> None:
    angles = bent(index_PIP_bend=40, index_DIP_bend=20, thumb_MCP_bend=20, ring_MCP_bend=30)
    found = repair_of(given_angles(angles), hand)
    assert float(found.moved.max()) < 0.05


def test_a_repair_moves_less_than_clamping_does(hand: HandModel) -> None:
    """An MCP that is bent too far: its clamped finger is elsewhere, and PIP and DIP can make up for it."""
    given = given_angles(bent(index_MCP_bend=110, index_PIP_bend=40, index_DIP_bend=20))
    found = repair_of(given, hand)
    parameters = found.before.hands.parameters
    clamped = found.before.knowledge.ranges.clamp(parameters.joint_angles)
    there = hand(clamped, parameters.shape).landmarks
    here = hand(parameters.joint_angles, parameters.shape).landmarks
    assert float(found.moved.mean()) < 1000 * float((there - here).norm(dim=-1).mean())


def test_movement_is_measured_between_the_two_hands(unnatural: RepairedHands) -> None:
    before, after = (one.hands for one in (unnatural.before, unnatural.after))
    by_hand = [
        1000 * math.dist(before.landmarks[1, i].tolist(), after.landmarks[1, i].tolist())
        for i in range(21)
    ]
    assert unnatural.moved[1].tolist() == pytest.approx(by_hand, abs=1e-2)


def test_the_shape_of_the_hand_is_kept(unnatural: RepairedHands) -> None:
    before, after = (one.hands.parameters.shape for one in (unnatural.before, unnatural.after))
    assert torch.allclose(before, after, atol=1e-3)


def written(records: HandRecords) -> HandRecords:
    return checked(list(hand_entries(records)), "a file")


def test_repaired_hands_are_a_file_of_hands_without_a_camera(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(4))
    points[0] *= MIRROR
    points[1, 3:15] = torch.nan
    found = repair_of(of_points(points, "points"), hand)
    records = written(to_records(found, "0"))
    assert records.verdicts == ("plausible", "not fitted", "plausible", "plausible")
    assert records.sides[0] == "left"
    assert records.cameras == ("none", None, "none", "none")
    assert set(records.sources) == {"audit, repair"}
    assert not records.intrinsics_known.any()
    fitted = records.landmarks_3d[[0, 2, 3]]
    assert (fitted[..., 2] > 0.1).all()
    # Where the hand is seen by the made-up camera: 500 px on a crop of 224.
    pixels = 500 * fitted[..., :2] / fitted[..., 2:] + 112
    assert pixels == pytest.approx(records.landmarks_2d[[0, 2, 3]], abs=1e-2)


def test_a_left_hand_comes_back_as_the_points_have_it(hand: HandModel) -> None:
    angles = bent(index_PIP_bend=40, middle_MCP_bend=30, thumb_MCP_bend=20)
    points = points_of(hand, angles)
    points = (points - points.mean(dim=1, keepdim=True)) * MIRROR + torch.tensor([0.0, 0.0, 0.7])
    found = repair_of(of_points(points, "points"), hand)
    records = to_records(found, "0")
    assert records.sides == ("left",)
    apart = torch.from_numpy(records.landmarks_3d).float() - points
    assert float(apart.norm(dim=-1).max()) < 3e-3
    mirror = MIRROR.double().numpy()
    rotation = mirror[:, None] * records.root_rotation[0] * mirror
    own = hand(torch.from_numpy(records.joint_angles_degrees).float().deg2rad(),
               torch.from_numpy(records.shape).float()).landmarks[0].double().numpy()  # fmt: skip
    posed = (own @ rotation.T + mirror * records.translation[0]) * mirror
    assert posed == pytest.approx(records.landmarks_3d[0], abs=1e-5)


def test_a_repair_beyond_the_limits_of_the_audit_is_doubtful(hand: HandModel) -> None:
    found = repaired(audit_of(given_angles(bent()), hand, shape=0.01), models_of(hand))
    records = written(to_records(found, "0"))
    assert records.verdicts == ("doubtful",)
    assert "standard deviations from the mean hand" in records.reasons[0][0]


def test_frames_of_a_clip_keep_their_numbers(hand: HandModel) -> None:
    moments = (Moment(2, 5, 0.2), Moment(2, 9, 0.4, seen=False))
    given = replace(given_angles(torch.cat([bent(), bent()])), moments=moments)
    assert to_records(repair_of(given, hand), "0").moments == moments
