"""Meshes on parts of large images: the same as on small ones, hidden where another is nearer."""

import math

import numpy as np
import pytest
import trimesh

from hand_recon.rendering import window
from hand_recon.rendering.mesh import shade
from hand_recon.rendering.window import PlacedMesh, ShadedWindow, shade_in_image

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
RED, GREEN = (255.0, 0.0, 0.0), (0.0, 255.0, 0.0)


def camera(focal: float = 100.0, centre: tuple[float, float] = (32.0, 32.0)) -> np.ndarray:
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])


def ball(
    position: tuple[float, float, float],
    colour: tuple[float, float, float] = RED,
    intrinsics: np.ndarray | None = None,
) -> PlacedMesh:
    vertices = np.asarray(BALL.vertices) + np.array(position)
    return PlacedMesh(
        vertices, np.asarray(BALL.faces), camera() if intrinsics is None else intrinsics, colour
    )


def drawn(meshes: list[PlacedMesh], width: int = 64, height: int = 64) -> np.ndarray:
    """The meshes on a black image."""
    image = np.zeros((height, width, 3), dtype=np.uint8)
    for part in shade_in_image(meshes, width, height):
        part.blend_into(image)
    return image


def test_a_window_equals_the_whole_image_to_the_pixel() -> None:
    mesh = ball((0.04, -0.03, 0.6))
    whole = shade(mesh.vertices, mesh.faces, mesh.intrinsics, 64, RED)
    expected = whole.over(np.zeros((64, 64, 3), dtype=np.uint8)).astype(int)
    assert np.abs(drawn([mesh]).astype(int) - expected).max() <= 1


def test_only_the_box_of_the_mesh_is_computed() -> None:
    (part,) = shade_in_image([ball((0.0, 0.0, 0.6))], 4000, 3000)
    # A ball of 8.4 px radius about (32, 32).
    assert (part.left, part.top) == (23, 23)
    assert part.light.shape == (18, 18)


@pytest.mark.parametrize("first", [0, 1])
def test_of_two_meshes_the_nearer_one_is_seen_whatever_their_order(first: int) -> None:
    meshes = [ball((0.0, 0.0, 0.6), RED), ball((0.02, 0.0, 0.9), GREEN)]
    image = drawn(meshes[first:] + meshes[:first])
    assert image[32, 32, 0] > 0
    assert image[32, 32, 1] == 0
    # The far ball ends at column 32 + 100 (0.02 + 0.05) / 0.9 = 39.8, the near one at 40.4.
    assert (image[..., 1] > 0).sum() < 5


def test_two_meshes_that_penetrate_each_other_are_each_seen_where_they_are_nearer() -> None:
    # Equal balls beside each other: each covers its own half of what both cover.
    image = drawn([ball((-0.02, 0.0, 0.6), RED), ball((0.02, 0.0, 0.6), GREEN)]).astype(int)
    assert (image[:, :31, 1] == 0).all()
    assert (image[:, 33:, 0] == 0).all()
    assert image[:, :32, 0].astype(bool).sum() == image[:, 32:, 1].astype(bool).sum()


def test_depths_under_different_assumed_cameras_are_compared_by_size_in_the_image() -> None:
    # At twice the focal length and twice the depth a ball looks the same: as near as the other. A little
    # less deep, it is nearer, although its depth is larger than the other's.
    near = ball((0.0, 0.0, 1.1), GREEN, camera(200.0))
    image = drawn([ball((0.0, 0.0, 0.6), RED), near])
    assert image[32, 32, 1] > 0
    assert image[32, 32, 0] == 0


@pytest.mark.parametrize("most", [100_000, 4_000, 1_000, 300])
def test_fewer_rays_change_the_area_and_place_little(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    monkeypatch.setattr(window, "MOST_SAMPLES", most)
    mesh = ball((0.012, -0.021, 0.6), RED, camera(500.0, (101.0, 83.0)))
    (part,) = shade_in_image([mesh], 301, 203)
    covered = np.zeros((203, 301))
    rows, columns = part.coverage.shape
    covered[part.top : part.top + rows, part.left : part.left + columns] = part.coverage
    radius = 500 * 0.05 / math.sqrt(0.6**2 - 0.05**2)
    assert abs(covered.sum() / (math.pi * radius**2) - 1) < 0.03
    v, u = np.mgrid[:203, :301] + 0.5
    assert abs((covered * u).sum() / covered.sum() - (101 + 10)) < 0.7
    assert abs((covered * v).sum() / covered.sum() - (83 - 17.5)) < 0.7


@pytest.mark.parametrize("most", [100_000, 500])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (33, 31)])
def test_a_mesh_larger_than_the_image_covers_all_of_it(
    monkeypatch: pytest.MonkeyPatch, most: int, size: tuple[int, int]
) -> None:
    monkeypatch.setattr(window, "MOST_SAMPLES", most)
    (part,) = shade_in_image([ball((0.0, 0.0, 0.06), RED, camera(500.0, (5.0, 5.0)))], *size)
    assert part.coverage.shape == size[::-1]
    assert (part.coverage == 1).all()


@pytest.mark.parametrize("most", [100_000, 500])
@pytest.mark.parametrize("place", [(0.0, 0.0), (64.0, 64.0), (0.0, 40.0), (60.0, -3.0)])
def test_a_mesh_across_the_edge_is_cut_there(
    monkeypatch: pytest.MonkeyPatch, most: int, place: tuple[float, float]
) -> None:
    monkeypatch.setattr(window, "MOST_SAMPLES", most)
    centred = ball((0.0, 0.0, 0.6), RED, camera(300.0, (96.0 + place[0], 96.0 + place[1])))
    cut = ball((0.0, 0.0, 0.6), RED, camera(300.0, place))
    whole = drawn([centred], 256, 256)[96:160, 96:160]
    # With fewer rays the grids differ by less than a step.
    assert np.abs(drawn([cut]).astype(int) - whole).mean() < (1 if most > 500 else 12)


def test_what_is_behind_the_camera_outside_or_not_finite_is_left_out() -> None:
    lost = ball((0.0, 0.0, 0.6))
    lost.vertices[3, 1] = np.nan
    beside = [ball((9.0, 0.0, 0.6)), ball((0.0, -9.0, 0.6))]
    assert shade_in_image([ball((0.0, 0.0, -0.6)), lost, *beside], 64, 64) == []
    assert shade_in_image([], 64, 64) == []


def test_what_reaches_behind_the_camera_is_drawn_where_it_is_in_front() -> None:
    (part,) = shade_in_image([ball((0.0, 0.03, 0.0))], 64, 64)
    # The camera is inside the ball, whose inside is all around.
    assert (part.left, part.top, part.coverage.shape) == (0, 0, (64, 64))
    assert (part.coverage == 1).all()


def test_far_meshes_come_first() -> None:
    meshes = [ball((0.1 * depth - 0.1, 0.0, depth), (depth, 0.0, 0.0)) for depth in (0.5, 2.0, 1.0)]
    assert [part.colour[0] for part in shade_in_image(meshes, 64, 64)] == [2.0, 1.0, 0.5]


def test_opacity_mixes_the_mesh_with_the_image_in_every_block_of_rows() -> None:
    tall = np.ones((700, 3), dtype=np.float32)
    part = ShadedWindow(2, 1, 0.5 * tall, tall, (200.0, 100.0, 0.0))
    image = np.full((702, 6, 3), 60, dtype=np.uint8)
    part.blend_into(image, opacity=0.25)
    # 0.75 · 60 + 0.25 · 0.5 · colour.
    assert (image[1:701, 2:5] == (70, 58, 45)).all()
    image[1:701, 2:5] = 60
    assert (image == 60).all()
