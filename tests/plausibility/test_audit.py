"""Findings, verdicts and rates of an audit."""

from dataclasses import replace

import pytest
import torch

from hand_recon.data.synthetic.unnatural import KINDS
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARKS
from hand_recon.plausibility.findings import bone_lengths
from hand_recon.plausibility.given_hands import joined_hands, of_points
from hand_recon.plausibility.posed_hands import posed_hands
from hand_recon.plausibility.verdicts import violations
from tests.support.audited_hands import (
    MIRROR,
    audit_of,
    bent,
    given_angles,
    models_of,
    natural_angles,
    points_of,
    row_of,
    unnatural_angles,
)


def test_degrees_beyond_a_bound_have_its_sign(hand: HandModel) -> None:
    """The table has −10 to 100° for the bend of the index PIP, 0 to 80° for that of the ring DIP."""
    found = audit_of(given_angles(bent(index_PIP_bend=-40, ring_DIP_bend=85)), hand)
    first, second = violations(found.findings, 0)
    assert (first.joint, first.axis) == ("index PIP", "bend")
    assert first.beyond == pytest.approx(-30, abs=0.01)
    assert second.joint == "ring DIP"
    assert second.beyond == pytest.approx(5, abs=0.01)
    assert first.text == "bend of the index PIP is -40°, 30° below its lower bound"
    assert found.verdicts[0].value == "implausible"
    assert len(found.verdicts[0].reasons) == 1


def test_functional_anatomy_leaves_half_of_the_splay_at_half_of_the_bend(hand: HandModel) -> None:
    """Index MCP: bend to 84.7°, splay to 32.1°. At 42.35° of bend 16.05° of splay are left (Eq. 2)."""
    angles = bent(index_MCP_bend=42.35, index_MCP_splay=20)
    found = audit_of(given_angles(angles), hand)
    assert violations(found.findings, 0) == []
    (only,) = violations(found.findings, 0, anatomy=True)
    assert only.beyond == pytest.approx(20 - 16.05, abs=0.01)
    assert found.verdicts[0].value == "plausible"
    strict = audit_of(given_angles(angles), hand, anatomy=True, degrees=3.0)
    assert strict.verdicts[0].value == "implausible"
    assert "as functional anatomy leaves it" in strict.verdicts[0].reasons[0]


def test_a_violation_of_a_range_is_not_counted_again_as_one_of_anatomy(hand: HandModel) -> None:
    found = audit_of(given_angles(bent(index_MCP_bend=40, index_MCP_splay=60)), hand)
    assert len(violations(found.findings, 0)) == 1
    assert violations(found.findings, 0, anatomy=True) == []


def test_a_hand_at_the_limit_is_plausible_and_just_beyond_is_not(hand: HandModel) -> None:
    angles = torch.cat([bent(index_PIP_bend=100 + beyond) for beyond in (22.4, 22.6)])
    found = audit_of(given_angles(angles), hand)
    assert [one.value for one in found.verdicts] == ["plausible", "implausible"]
    assert "expected within 22.5° of it" in found.verdicts[1].reasons[0]


def test_a_finger_through_the_palm_penetrates(hand: HandModel) -> None:
    through = bent(middle_MCP_bend=108, middle_PIP_bend=112, middle_DIP_bend=30)
    found = audit_of(given_angles(torch.cat([through, bent()])), hand, degrees=90.0)
    assert float(found.findings.depth[0]) > 8
    assert float(found.findings.depth[1]) == 0.0
    assert float(found.findings.deep[0]) > 0
    assert [one.value for one in found.verdicts] == ["implausible", "plausible"]
    assert "mm inside another, expected up to 8 mm" in found.verdicts[0].reasons[0]
    assert found.summary()["penetration_rate_percent"] == 50.0


def test_natural_hands_pass_and_unnatural_ones_are_caught(hand: HandModel) -> None:
    """With given angles. A finger may be in another with every joint in its range; the paper's 6 mm catch
    19 of 20 of these, and call 1 of 20 natural hands implausible (docs/audit.md)."""
    natural = audit_of(given_angles(natural_angles(100, seed=3)), hand).summary()
    assert natural["implausible_percent"] <= 2.0
    for kind in set(KINDS) - {"penetrating"}:
        found = audit_of(given_angles(unnatural_angles(kind, 20)), hand).summary()
        assert found["implausible_percent"] == 100.0, kind
    given = given_angles(unnatural_angles("penetrating", 60, seed=1))
    assert audit_of(given, hand).summary()["implausible_percent"] >= 75.0
    assert audit_of(given, hand, depth=6.0).summary()["implausible_percent"] >= 90.0


def test_twist_counts_where_angles_are_given_and_not_where_points_are(hand: HandModel) -> None:
    angles = bent(middle_PIP_twist=60)
    exact = audit_of(given_angles(angles), hand)
    assert row_of(exact, "middle PIP", "twist")["greatest_violation_degrees"] == pytest.approx(
        60, abs=0.1
    )
    points = audit_of(of_points(points_of(hand, angles), "points", left=[False]), hand)
    assert not points.findings.counted[..., AXES.index("twist")].any()
    assert all(row["axis"] != "twist" for row in points.joints())


def test_points_of_hyper_bent_fingers_are_caught_without_their_angles(hand: HandModel) -> None:
    points = points_of(hand, unnatural_angles("hyper_bent", 30))
    assert audit_of(of_points(points, "points"), hand).summary()["implausible_percent"] >= 95.0
    natural = points_of(hand, natural_angles(60, seed=2))
    assert audit_of(of_points(natural, "points"), hand).summary()["implausible_percent"] <= 2.0


def test_left_and_right_hands_among_points_are_told_apart(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(40))
    points[::2] *= MIRROR
    found = posed_hands(of_points(points, "points"), models_of(hand))
    assert found.left.tolist() == [True, False] * 20
    assert torch.equal(found.points[::2], points[::2] * MIRROR)


def test_a_given_side_is_believed(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(2))
    models = models_of(hand)
    assert posed_hands(of_points(points, "a", left=[True, True]), models).left.all()
    assert posed_hands(of_points(points, "a"), models, side="left").left.all()
    with pytest.raises(ValueError, match="side=both is unknown; expected auto, left or right"):
        posed_hands(of_points(points, "a"), models, side="both")


def test_a_bone_of_twice_its_length_is_named(hand: HandModel) -> None:
    points = points_of(hand, bent())
    tip, before = (LANDMARKS.index(f"index {part}") for part in ("tip", "DIP"))
    points[0, tip] += points[0, tip] - points[0, before]
    found = audit_of(of_points(points, "points", left=[False]), hand)
    assert found.verdicts[0].value == "implausible"
    assert any("The bone to the index tip is +" in reason for reason in found.verdicts[0].reasons)


def test_bone_lengths_of_known_points() -> None:
    points = torch.zeros(21, 3)
    points[:, 0] = torch.arange(21.0)
    lengths = bone_lengths(points)
    assert lengths[0].isnan()
    # Each finger begins at the wrist, landmark 0.
    assert lengths[1:].tolist() == [float(i) if i % 4 == 1 else 1.0 for i in range(1, 21)]


def test_hands_with_too_few_landmarks_are_not_audited(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(2))
    points[0, 3:15] = torch.nan
    found = audit_of(of_points(points, "points"), hand)
    assert [one.value for one in found.verdicts] == ["not audited", "plausible"]
    assert "expected 12 or more of 21" in found.verdicts[0].reasons[0]
    assert (found.summary()["hands"], found.summary()["audited"]) == (2, 1)
    assert float(found.badness()[0]) == -1.0


def test_angles_of_a_hand_without_its_model_are_audited_without_a_mesh(hand: HandModel) -> None:
    given = replace(given_angles(bent(index_PIP_bend=-60)), hand_models=("mano",))
    found = audit_of(given, hand)
    assert found.verdicts[0].value == "implausible"
    assert found.findings.depth.isnan().all()
    assert found.summary()["penetration_rate_percent"] is None


def test_rates_by_joint_are_over_all_hands(hand: HandModel) -> None:
    angles = torch.cat([bent(index_PIP_bend=degrees) for degrees in (50, 103, 130, 140)])
    row = row_of(audit_of(given_angles(angles), hand), "index PIP", "bend")
    assert (row["violated_percent"], row["beyond_limit_percent"]) == (75.0, 50.0)
    assert row["greatest_violation_degrees"] == pytest.approx(40, abs=0.01)
    assert row["median_degrees"] == pytest.approx(103, abs=0.01)
    assert ARTICULATED.index(str(row["joint"])) == 1


def test_files_without_hands_are_refused() -> None:
    with pytest.raises(ValueError, match="The files hold no hand; expected one or more"):
        joined_hands([of_points(torch.zeros(0, 21, 3), "empty")])


def test_turns_that_a_fit_counted_are_no_violation(hand: HandModel) -> None:
    """288° of bend are −72°, 72° below 0; and half a turn of all three axes is no turn at all."""
    angles = torch.cat(
        [
            bent(middle_DIP_bend=288),
            bent(index_PIP_bend=40 + 180, index_PIP_splay=180, index_PIP_twist=180),
            bent(thumb_CMC_twist=120),
        ]
    )
    given = given_angles(angles)
    found = audit_of(given, hand)
    assert found.findings.worst_range.tolist() == pytest.approx([72, 0, 120], abs=0.01)
    # The pose is the same.
    there = hand(angles, given.parameters.shape).landmarks
    here = hand(found.hands.parameters.joint_angles, given.parameters.shape).landmarks
    assert torch.allclose(here, there, atol=1e-6)


def test_hands_of_zeros_are_missing_and_do_not_hide_the_unit(hand: HandModel) -> None:
    points = torch.cat([1000 * points_of(hand, natural_angles(2)), torch.zeros(3, 21, 3)])
    found = audit_of(of_points(points, "points"), hand)
    assert [one.value for one in found.verdicts] == ["plausible"] * 2 + ["not audited"] * 3
    assert (
        "All points of 3 of 5 hands are one point; these hands are missing."
        in found.hands.given.notes
    )
    assert "points: the points are in millimetres." in found.hands.given.notes


def test_the_worst_hand_is_that_of_anatomy_where_it_counts(hand: HandModel) -> None:
    given = given_angles(
        torch.cat([bent(index_PIP_bend=110), bent(little_MCP_bend=84, little_MCP_splay=-50)])
    )
    for anatomy, worst in ((False, 0), (True, 1)):
        badness = audit_of(given, hand, anatomy=anatomy).badness()
        assert int(badness.argmax()) == worst
    assert audit_of(given, hand, degrees=0.0).badness().isfinite().all()
