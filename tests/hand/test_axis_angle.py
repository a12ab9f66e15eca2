"""Axis angles and rotations against SciPy, and near 0° and 180°."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hand_recon.hand.axis_angle import (
    axis_angle_to_rotation,
    mirror_axis_angle,
    rotation_to_axis_angle,
)
from tests.support.tolerance import BATCH_SHAPES, assert_close


def _directions(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 3.0, np.pi - 1e-7, np.pi, 5.0])
def test_rotations_are_those_of_an_independent_library_and_come_back(angle: float) -> None:
    axis_angles = angle * _directions(20)
    expected = torch.from_numpy(Rotation.from_rotvec(axis_angles.numpy()).as_matrix())
    rotation = axis_angle_to_rotation(axis_angles)
    assert_close(rotation, expected)
    back = rotation_to_axis_angle(rotation)
    assert_close(axis_angle_to_rotation(back), expected)
    assert back.norm(dim=-1).max() < np.pi + 1e-9
    if angle < 3.1:
        torch.testing.assert_close(back, axis_angles, atol=1e-9, rtol=1e-9)


def test_ninety_degrees_about_x_take_y_to_z() -> None:
    rotated = axis_angle_to_rotation(torch.tensor([np.pi / 2, 0.0, 0.0])) @ torch.tensor(
        [0.0, 1, 0]
    )
    torch.testing.assert_close(rotated, torch.tensor([0.0, 0.0, 1.0]), atol=1e-6, rtol=0)


def test_the_gradient_is_exact_at_the_identity_and_elsewhere() -> None:
    for scale in (0.0, 0.7):
        axis_angles = (scale * _directions(3)).requires_grad_()
        assert torch.autograd.gradcheck(axis_angle_to_rotation, axis_angles)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_a_mirrored_axis_angle_is_the_rotation_conjugated_by_the_mirror(
    shape: tuple[int, ...],
) -> None:
    axis_angles = torch.randn(*shape, 3, dtype=torch.float64)
    mirror = torch.diag(torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    expected = mirror @ axis_angle_to_rotation(axis_angles) @ mirror
    assert_close(axis_angle_to_rotation(mirror_axis_angle(axis_angles)), expected)
