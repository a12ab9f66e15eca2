"""The pose in closed form from 3D landmarks."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.plausibility.point_start import rotation_between, start_of_points
from hand_recon.schema import HandParameters
from tests.support.audited_hands import bent, natural_angles, parameters_of


def test_bend_and_splay_of_the_mean_hand_come_back_exactly(hand: HandModel) -> None:
    angles = natural_angles(20)
    angles[..., 2] = 0.0
    true = parameters_of(angles, spread=0.0)
    found = start_of_points(hand, hand.to_camera(true).landmarks)
    # The bones to the tips are not exactly along the axes of the last joints.
    assert float((found.joint_angles - angles).abs().rad2deg().max()) < 0.5
    assert float((found.root_rotation - true.root_rotation).abs().max()) < 1e-3


@settings(max_examples=12)
@given(bend=st.floats(-170, 170), splay=st.floats(-60, 60))
def test_a_bone_that_points_backwards_is_bent_and_not_splayed(bend: float, splay: float) -> None:
    hand = open_hand()
    angles = bent(index_MCP_bend=bend, index_MCP_splay=splay)
    posed = hand.to_camera(parameters_of(angles, spread=0.0)).landmarks
    found = start_of_points(hand, posed).joint_angles[0, 0].rad2deg()
    # At ±90° of bend the splay moves no landmark of this bone.
    if abs(abs(bend) - 90) > 1:
        assert abs(float(found[0]) - bend) < 0.5
        assert abs(float(found[1]) - splay) < 2.0


def test_missing_fingers_are_left_straight(hand: HandModel) -> None:
    points = hand.to_camera(parameters_of(natural_angles(3))).landmarks
    points[:, 17:] = torch.nan
    found = start_of_points(hand, points).joint_angles
    assert bool(found.isfinite().all())
    assert float(found[:, 6:9].abs().max()) == 0.0


def test_the_rotation_between_point_sets_is_proper_and_ignores_unused_points() -> None:
    source = torch.randn(5, 21, 3)
    rotation = axis_angle_to_rotation(torch.randn(5, 3))
    target = source @ rotation.mT + torch.randn(5, 1, 3)
    used = torch.ones(5, 21, dtype=torch.bool)
    used[:, 7] = False
    target[:, 7] = torch.nan
    assert torch.allclose(rotation_between(source, target, used), rotation, atol=1e-4)
    mirrored = rotation_between(source, target * torch.tensor([-1.0, 1.0, 1.0]), used)
    assert torch.allclose(torch.linalg.det(mirrored), torch.ones(5), atol=1e-4)


def test_the_start_needs_no_position(hand: HandModel) -> None:
    parameters = parameters_of(natural_angles(4))
    moved = HandParameters(*(*list(vars(parameters).values())[:3], parameters.translation + 7.0))
    both = [start_of_points(hand, hand.to_camera(one).landmarks) for one in (parameters, moved)]
    assert torch.allclose(both[0].joint_angles, both[1].joint_angles, atol=1e-3)
