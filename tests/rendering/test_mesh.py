"""Shaded meshes cover the pixels of their projection."""

import numpy as np
import trimesh

from hand_recon.rendering.mesh import RotatedView, from_the_side, shade

INTRINSICS = np.array([[100.0, 0, 32], [0, 100.0, 32], [0, 0, 1]])


def test_a_ball_covers_the_disc_that_it_projects_to() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    vertices = ball.vertices + np.array([0.06, -0.03, 0.6])
    shaded = shade(vertices, ball.faces, INTRINSICS, 64)
    rows, columns = np.nonzero(shaded.coverage[..., 0] > 0.5)
    assert abs(columns.mean() + 0.5 - (32 + 100 * 0.06 / 0.6)) < 0.3
    assert abs(rows.mean() + 0.5 - (32 - 100 * 0.03 / 0.6)) < 0.3
    radius = 100 * 0.05 / np.sqrt(0.6**2 - 0.05**2)
    assert abs(shaded.coverage.sum() / (np.pi * radius**2) - 1) < 0.08


def test_pixels_outside_the_mesh_keep_the_background() -> None:
    ball = trimesh.creation.icosphere(radius=0.02)
    background = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    shaded = shade(ball.vertices + np.array([0, 0, 0.6]), ball.faces, INTRINSICS, 64)
    over = shaded.over(background)
    outside = shaded.coverage[..., 0] == 0
    assert (over[outside] == background[outside]).all()
    assert (over[~outside] != background[~outside]).any()


def test_from_the_side_depth_becomes_width() -> None:
    box = trimesh.creation.box(extents=(0.02, 0.05, 0.2))
    image = from_the_side(box.vertices + np.array([0, 0, 0.6]), box.faces, 64)
    rows, columns = np.nonzero((image < 255).any(axis=-1))
    assert np.ptp(columns) > 3 * np.ptp(rows)
    assert 50 < np.ptp(columns) <= 64


def test_from_the_side_a_mesh_seen_end_on_stays_inside_the_image() -> None:
    box = trimesh.creation.box(extents=(0.2, 0.02, 0.02))
    image = from_the_side(box.vertices + np.array([0, 0, 0.6]), box.faces, 64)
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    assert (border == 255).all()
    assert (image < 255).any()


def test_points_project_to_where_a_view_renders_them() -> None:
    """A long box fills the view, and a small ball is seen at the projection of its centre."""
    box = trimesh.creation.box(extents=(0.02, 0.05, 0.2)).vertices + np.array([0, 0, 0.6])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.008)
    for view in (RotatedView.from_the_side(box), RotatedView.from_above(box)):
        for centre in np.array([[0.005, 0.01, 0.65], [-0.005, -0.02, 0.54]]):
            image = view.render(ball.vertices + centre, ball.faces, 200)
            rows, columns = np.nonzero((image < 255).any(axis=-1))
            middle = np.array([columns.mean(), rows.mean()]) + 0.5
            np.testing.assert_allclose(middle, view.project(centre[None], 200)[0], atol=0.5)


def test_from_the_side_the_scale_is_that_of_the_longest_extent() -> None:
    """20 cm of depth are 0.45 of twice the half width at the middle's distance: 4 · 0.25 · 0.45 · 2 = 0.9."""
    box = trimesh.creation.box(extents=(0.02, 0.05, 0.2)).vertices + np.array([0, 0, 0.6])
    view = RotatedView.from_the_side(box)
    pixels = view.project(np.array([[0, 0, 0.5], [0, 0, 0.7]]), 100)
    np.testing.assert_allclose(pixels, [[5, 50], [95, 50]])


def test_projected_covariances_agree_with_finite_differences() -> None:
    random = np.random.default_rng(0)
    points = random.normal(scale=0.05, size=(6, 3)) + np.array([0.1, 0, 0.6])
    root = random.normal(scale=0.01, size=(6, 3, 3))
    covariance = root @ root.transpose(0, 2, 1)
    for view in (RotatedView.from_the_side(points), RotatedView.from_above(points)):
        slope = np.stack(
            [
                (view.project(points + step, 300) - view.project(points - step, 300)) / 2e-6
                for step in 1e-6 * np.eye(3)
            ],
            axis=-1,
        )
        expected = slope @ covariance @ slope.transpose(0, 2, 1)
        found = view.project_covariance(points, covariance, 300)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
