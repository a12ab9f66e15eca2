"""Directions of bend, splay and twist, and round trips between angles and rotations."""

import math

import hypothesis
import pytest
import torch
from hypothesis import strategies

from hand_recon.hand.anatomical_frame import (
    angles_to_rotation,
    joint_angles_of,
    joint_rotations,
    rotation_to_angles,
)
from hand_recon.hand.model import HandModel


def _about(axis: int, angle: float) -> torch.Tensor:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = torch.eye(3, dtype=torch.float64)
    matrix[first, first] = matrix[second, second] = math.cos(angle)
    matrix[second, first], matrix[first, second] = math.sin(angle), -math.sin(angle)
    return matrix


def test_the_rotation_is_splay_then_twist_then_bend_written_out() -> None:
    bend, splay, twist = 0.7, -0.4, 0.2
    expected = _about(1, splay) @ _about(0, twist) @ _about(2, bend)
    rotation = angles_to_rotation(torch.tensor([bend, splay, twist], dtype=torch.float64))
    torch.testing.assert_close(rotation, expected)


def test_ninety_degrees_of_bend_point_a_finger_into_the_palm() -> None:
    finger = torch.tensor([-1.0, 0.0, 0.0])
    bent = angles_to_rotation(torch.tensor([math.pi / 2, 0.0, 0.0])) @ finger
    torch.testing.assert_close(bent, torch.tensor([0.0, -1.0, 0.0]), atol=1e-6, rtol=0)


def test_ninety_degrees_of_splay_point_a_finger_to_the_thumb() -> None:
    finger = torch.tensor([-1.0, 0.0, 0.0])
    splayed = angles_to_rotation(torch.tensor([0.0, math.pi / 2, 0.0])) @ finger
    torch.testing.assert_close(splayed, torch.tensor([0.0, 0.0, 1.0]), atol=1e-6, rtol=0)


@hypothesis.given(
    strategies.floats(-3.1, 3.1), strategies.floats(-3.1, 3.1), strategies.floats(-1.5, 1.5)
)
def test_angles_come_back_from_their_rotation(bend: float, splay: float, twist: float) -> None:
    angles = torch.tensor([bend, splay, twist], dtype=torch.float64)
    back = rotation_to_angles(angles_to_rotation(angles))
    torch.testing.assert_close(back, angles, atol=1e-9, rtol=0)


def test_rotations_come_back_from_their_angles() -> None:
    rotation, _ = torch.linalg.qr(torch.randn(50, 3, 3, dtype=torch.float64))
    rotation = rotation * torch.linalg.det(rotation)[:, None, None]
    torch.testing.assert_close(angles_to_rotation(rotation_to_angles(rotation)), rotation)


def test_joint_angles_come_back_from_the_hands_rotations(hand: HandModel) -> None:
    angles = 2.8 * torch.rand(7, 15, 3) - 1.4
    rotations = joint_rotations(angles, hand.frames, hand.rest_angles)
    back = joint_angles_of(rotations, hand.frames, hand.rest_angles)
    torch.testing.assert_close(back, angles, atol=1e-5, rtol=0)


def test_the_rest_angles_leave_the_rest_pose_alone(hand: HandModel) -> None:
    rotations = joint_rotations(hand.rest_angles, hand.frames, hand.rest_angles)
    torch.testing.assert_close(rotations, torch.eye(3).expand(15, 3, 3), atol=1e-5, rtol=0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_angles_gradient_matches_finite_differences(axis: int) -> None:
    angles = 0.4 * torch.randn(4, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(
        lambda a: rotation_to_angles(angles_to_rotation(a))[:, axis], angles
    )
    assert torch.autograd.gradcheck(angles_to_rotation, angles)
