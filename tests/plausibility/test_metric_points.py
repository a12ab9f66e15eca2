"""Units and orders of points without a description."""

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.plausibility.given_hands import joined_hands, of_points
from hand_recon.plausibility.joint_orders import WEBXR, to_landmarks
from hand_recon.plausibility.metric_points import MEAN_DIAGONAL, in_metres, metres_per_unit
from tests.support.audited_hands import given_angles, natural_angles, points_of


@pytest.mark.parametrize(
    ("unit", "factor"), [("metres", 1.0), ("centimetres", 100.0), ("millimetres", 1000.0)]
)
def test_the_unit_is_recognised_by_the_size_of_hands(
    hand: HandModel, unit: str, factor: float
) -> None:
    points = points_of(hand, natural_angles(8))
    found = in_metres(of_points(points * factor, "points"))
    assert torch.allclose(found.points, points, rtol=1e-5, atol=1e-6)
    assert bool(found.notes) == (unit != "metres")


def test_hands_of_no_known_unit_get_the_size_of_an_adult(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(9)) * 77_000
    factor, unit = metres_per_unit(points)
    assert unit is None
    diagonals = (points.amax(dim=1) - points.amin(dim=1)).norm(dim=-1) * factor
    assert float(diagonals.median()) == pytest.approx(MEAN_DIAGONAL, rel=1e-5)
    assert "the unit of the points was not recognised" in in_metres(of_points(points, "x")).notes[0]


def test_every_file_has_a_unit_and_an_order_of_its_own(hand: HandModel) -> None:
    points = points_of(hand, natural_angles(20))
    ho3d = points[:, list(landmark_permutation("freihand", "ho3d"))] * 1000
    both = in_metres(joined_hands([of_points(points, "a"), of_points(ho3d, "b")]))
    assert torch.allclose(both.points[20:], points, atol=1e-6)
    assert any("b: the landmarks are in the order ho3d" in note for note in both.notes)


def test_given_angles_are_left_alone() -> None:
    given = given_angles(natural_angles(3))
    assert in_metres(given).notes == ()


def test_an_unknown_order_is_refused(hand: HandModel) -> None:
    given = of_points(points_of(hand, natural_angles(1)), "a")
    with pytest.raises(ValueError, match="order=mine is unknown; expected auto or one of"):
        in_metres(given, "mine")


def test_landmarks_among_the_joints_of_headsets() -> None:
    """WebXR's joints but the four fingers' metacarpals; OpenXR has the palm before them."""
    joints = torch.arange(25.0)[:, None].expand(25, 3)
    expected = [0, 1, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 14, 16, 17, 18, 19, 21, 22, 23, 24]
    assert len(WEBXR) == 25
    assert WEBXR[6] == "index-finger-phalanx-proximal"
    assert to_landmarks(joints)[:, 0].tolist() == expected
    with_palm = torch.cat([torch.full((1, 3), -1.0), joints])
    assert to_landmarks(with_palm)[:, 0].tolist() == expected
    with pytest.raises(ValueError, match="A hand has 24 points; expected 21 landmarks"):
        to_landmarks(joints[:24])


def test_pixels_with_a_confidence_are_no_points() -> None:
    points = torch.rand(2, 21, 3) * torch.tensor([200.0, 200.0, 1.0])
    with pytest.raises(
        ValueError, match="holds 2D landmarks in pixels with a confidence; expected 3D"
    ):
        in_metres(of_points(points, "hands.json"))
