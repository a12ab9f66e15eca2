"""Projection, translation from raw numbers, and the conversion between cameras."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.camera import (
    bounded_log_scale,
    default_intrinsics,
    project,
    project_array,
    raw_to_translation,
    rotation_between,
    six_d_to_rotation,
    to_true_camera,
)
from tests.support.tolerance import BATCH_SHAPES, assert_close


def double(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_a_point_on_the_axis_falls_on_the_centre_of_the_crop() -> None:
    pixel = project(double(0, 0, 0.6)[None], default_intrinsics(224, double(0)))
    assert_close(pixel, double(112, 112)[None])


def test_ten_centimetres_at_half_a_metre_are_a_hundred_pixels() -> None:
    pixels = project(double(0.1, -0.1, 0.5)[None], default_intrinsics(224, double(0)))
    assert_close(pixels, double(212, 12)[None])


def test_the_same_hand_covers_the_same_share_of_a_crop_of_any_size() -> None:
    points = torch.randn(5, 3, dtype=torch.float64) * 0.05 + double(0, 0, 0.6)
    large = project(points, default_intrinsics(224, points))
    small = project(points, default_intrinsics(96, points))
    assert_close(small / 96, large / 224)


def test_a_raw_scale_of_six_point_seven_puts_a_hand_at_sixty_centimetres() -> None:
    translation = raw_to_translation(double(math.log(500 / 0.6), 0.01, -0.02))
    assert_close(translation, double(0.01, -0.02, 0.6))


def test_the_log_scale_is_unchanged_in_the_middle_and_bounded() -> None:
    raw = double(-1e3, 6.55, 6.7, 1e3)
    bounded = bounded_log_scale(raw)
    assert_close(bounded[[0, 1, 3]], double(5.5, 6.55, 7.6))
    assert abs(bounded[2].item() - 6.7) < 2e-3
    # 18 cm in the crop of 224 pixels.
    spans = 0.18 * bounded.exp() / 224
    assert 0.19 < spans[0] < 0.21
    assert 1.5 < spans[3] < 1.7


def test_points_behind_the_camera_have_finite_pixels_and_gradients() -> None:
    points = torch.tensor([[0.1, 0.0, -0.3], [0.0, 0.1, 0.0]], requires_grad=True)
    pixels = project(points, default_intrinsics(224, points))
    pixels.sum().backward()
    assert points.grad is not None
    assert torch.isfinite(pixels).all()
    assert torch.isfinite(points.grad).all()


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_six_numbers_always_make_a_rotation(shape: tuple[int, ...]) -> None:
    rotation = six_d_to_rotation(torch.randn(*shape, 6, dtype=torch.float64))
    assert rotation.shape == (*shape, 3, 3)
    assert_close(rotation @ rotation.mT, torch.eye(3, dtype=torch.float64).expand_as(rotation))
    assert_close(torch.linalg.det(rotation), torch.ones(shape, dtype=torch.float64))


def test_six_numbers_of_a_rotation_recover_it() -> None:
    rotation = six_d_to_rotation(torch.randn(7, 6, dtype=torch.float64))
    assert_close(six_d_to_rotation(rotation[..., :2].mT.flatten(-2)), rotation)


def test_the_smallest_rotation_takes_source_to_target_and_keeps_their_normal() -> None:
    source, target = torch.randn(2, 9, 3, dtype=torch.float64)
    rotation = rotation_between(source, target)
    unit = torch.nn.functional.normalize
    assert_close(torch.einsum("bxy,by->bx", rotation, unit(source, dim=-1)), unit(target, dim=-1))
    normal = torch.linalg.cross(source, target)
    assert_close(torch.einsum("bxy,by->bx", rotation, normal), normal)


def test_the_true_camera_of_an_uncalibrated_crop_changes_nothing() -> None:
    rotation = six_d_to_rotation(torch.randn(4, 6, dtype=torch.float64))
    translation = torch.randn(4, 3, dtype=torch.float64) * 0.05 + double(0, 0, 0.6)
    same = to_true_camera(
        rotation, translation, default_intrinsics(96, rotation).expand(4, 3, 3), 96
    )
    assert_close(same[0], rotation)
    assert_close(same[1], translation)


@given(
    focal=st.floats(150, 2000),
    x=st.floats(-400, 600),
    y=st.floats(-400, 600),
    skew=st.floats(-5, 5),
)
def test_the_hand_stays_where_it_is_in_the_crop_under_any_camera(
    focal: float, x: float, y: float, skew: float
) -> None:
    true = double(focal, skew, x, 0, focal, y, 0, 0, 1).reshape(1, 3, 3)
    translation = double(0.03, -0.02, 0.6)[None]
    eye = torch.eye(3, dtype=torch.float64)[None]
    _, moved = to_true_camera(eye, translation, true, 224)
    before = project(translation[:, None], default_intrinsics(224, eye).expand(1, 3, 3))
    assert_close(project(moved[:, None], true), before)
    assert_close(moved[:, 2], translation[:, 2] * focal / 500)


def test_a_small_hand_looks_the_same_through_a_long_lens_off_centre() -> None:
    """A small object covers the same pixels under the true camera, except for perspective effects."""
    points = torch.randn(21, 3, dtype=torch.float64) * 1e-4
    translation = double(0.05, 0.02, 0.6)[None]
    eye = torch.eye(3, dtype=torch.float64)[None]
    assumed = default_intrinsics(224, eye).expand(1, 3, 3)
    true = double(800, 0, 400, 0, 800, -50, 0, 0, 1).reshape(1, 3, 3)
    rotation, moved = to_true_camera(eye, translation, true, 224)
    before = project(points[None] + translation[:, None], assumed)
    after = project(points[None] @ rotation.mT + moved[:, None], true)
    spread = (before - before.mean(dim=1, keepdim=True)).norm()
    # The image plane stretches off its centre, here by at most the squared cosine of the ray.
    assert (after - before).norm() < 0.35 * spread


def test_projection_of_numpy_points_agrees_with_a_hand_computed_pixel() -> None:
    intrinsics = np.array([[100.0, 0, 30], [0, 200.0, 40], [0, 0, 1]])
    points = np.array([[0.1, -0.2, 0.5]])
    np.testing.assert_allclose(project_array(points, intrinsics), [[50.0, -40.0]])


def test_numpy_points_and_tensors_have_the_same_pixels_with_one_camera_or_many() -> None:
    points = torch.randn(3, 21, 3, dtype=torch.float64) * 0.1 + torch.tensor([0.0, 0.0, 0.6])
    cameras = torch.tensor([[500.0, 3, 110], [0, 480, 120], [0, 0, 1]]).double().expand(3, 3, 3)
    expected = project(points, cameras).numpy()
    many = project_array(points.numpy(), cameras.numpy())
    one = project_array(points.numpy(), cameras[0].numpy())
    np.testing.assert_allclose(many, expected, rtol=1e-12)
    np.testing.assert_allclose(one, expected, rtol=1e-12)
