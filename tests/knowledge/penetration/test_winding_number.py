"""The generalized winding number of closed surfaces."""

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.winding_number import winding_number
from hand_recon.speed.published import depth_by_definition as reference
from tests.support.largest_tensor import LargestTensor
from tests.support.random_surfaces import capped, random_vertices
from tests.support.tolerance import assert_close


def solid(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    """Vertices, as one hand, and faces."""
    return torch.tensor(mesh.vertices)[None], torch.tensor(np.array(mesh.faces))


def winding(points: list[list[float]], mesh: trimesh.Trimesh) -> Tensor:
    """Winding numbers of one mesh about points."""
    first = torch.zeros(len(points), dtype=torch.long)
    return winding_number(torch.tensor(points, dtype=torch.float64), first, *solid(mesh))


def test_a_sphere_is_once_around_what_is_inside_and_not_around_what_is_outside() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2)
    actual = winding([[0, 0, 0], [0.5, -0.3, 0.6], [0, 0, 0.97], [1.01, 0, 0], [9, 9, 9]], sphere)
    assert_close(actual, torch.tensor([1.0, 1, 1, 0, 0]))


def test_where_two_spheres_overlap_the_surface_is_twice_around() -> None:
    one = trimesh.creation.icosphere()
    vertices = np.concatenate([one.vertices, one.vertices + np.array([1, 0, 0])])
    faces = np.concatenate([one.faces, one.faces + len(one.vertices)])
    both = trimesh.Trimesh(vertices, faces, process=False)
    assert_close(winding([[0.5, 0, 0], [-0.5, 0, 0], [1.5, 0, 0]], both), torch.tensor([2.0, 1, 1]))


def test_a_surface_inside_out_counts_backwards() -> None:
    sphere = trimesh.creation.icosphere()
    sphere.invert()
    assert_close(winding([[0, 0, 0]], sphere), torch.tensor([-1.0]))


def test_a_side_of_a_cube_is_a_sixth_of_what_its_middle_sees() -> None:
    cube = trimesh.creation.box()
    side = trimesh.Trimesh(cube.vertices, cube.faces[cube.face_normals[:, 2] > 0.5], process=False)
    assert_close(winding([[0, 0, 0]], side), torch.tensor([1 / 6]))


def test_a_corner_of_a_cube_sees_the_eighth_of_directions_that_lead_inwards() -> None:
    cube = trimesh.creation.box()
    assert_close(winding([[0.5, 0.5, 0.5], [-0.5, 0.5, -0.5]], cube), torch.tensor([0.125, 0.125]))


def test_a_vertex_of_the_surface_is_above_one_only_inside_another_layer(hand: HandModel) -> None:
    """Without its own triangles, the result is that of a point just outside the surface."""
    vertices = random_vertices(hand, 1, spread=0.9).double()
    points, faces = capped(hand, vertices)
    hands = torch.zeros(778, dtype=torch.long)
    on = winding_number(vertices[0], hands, points, faces)
    mesh = trimesh.Trimesh(points[0].numpy(), faces.numpy(), process=False)
    outside = vertices[0] + 1e-7 * torch.tensor(mesh.vertex_normals[:778])
    just_outside = winding_number(outside, hands, points, faces).round()
    assert int((just_outside >= 1).sum()) > 5, "the pose overlaps itself"
    away = torch.ones(778, dtype=torch.bool)
    away[hand.wrist_ring] = False
    # At a few vertices skinning has inverted the skin, and outside along the normal is inside.
    agree = ((on > 1) == (just_outside >= 1))[away]
    assert float(agree.double().mean()) > 0.995


def test_each_query_is_asked_about_its_own_hand(hand: HandModel) -> None:
    points, faces = capped(hand, random_vertices(hand, 3, spread=0.5).double())
    asked = torch.tensor([2, 0, 1, 2, 0])
    places = 0.04 * torch.randn(5, 3, dtype=torch.float64)
    actual = winding_number(places, asked, points, faces)
    one_by_one = [
        reference.winding_numbers(point[None].numpy(), points[i][faces].numpy())
        for point, i in zip(places, asked.tolist(), strict=True)
    ]
    assert_close(actual, torch.tensor(np.concatenate(one_by_one)))


def test_agrees_with_trimesh_about_random_hands(hand: HandModel) -> None:
    """Trimesh counts how often a ray meets the surface: odd is inside, and so is an odd winding number."""
    for vertices in random_vertices(hand, 3, spread=0.5).double():
        points, faces = capped(hand, vertices[None])
        mesh = trimesh.Trimesh(points[0].numpy(), faces.numpy(), process=False)
        places = vertices[torch.randint(778, (200,))] + 0.006 * torch.randn(200, 3)
        turns = winding_number(places, torch.zeros(200, dtype=torch.long), points, faces)
        assert_close(turns, turns.round())
        odd = turns.round().remainder(2) == 1
        agree = torch.tensor(mesh.contains(places.numpy())) == odd
        assert 20 < int(odd.sum()) < 180
        # A ray that grazes an edge is sometimes counted wrongly.
        assert float(agree.double().mean()) >= 0.99


@pytest.mark.parametrize("at_once", [1, 5000, 10**9])
def test_the_bound_on_memory_changes_no_value(hand: HandModel, at_once: int) -> None:
    points, faces = capped(hand, random_vertices(hand, 2, spread=0.5).double())
    places, asked = 0.03 * torch.randn(20, 3, dtype=torch.float64), torch.arange(20) % 2
    expected = winding_number(places, asked, points, faces)
    assert_close(winding_number(places, asked, points, faces, at_once=at_once), expected)


def test_the_bound_on_memory_is_kept(hand: HandModel) -> None:
    points, faces = capped(hand, random_vertices(hand, 2, spread=0.5).double())
    places, asked = torch.randn(300, 3, dtype=torch.float64), torch.arange(300) % 2
    with LargestTensor() as bounded:
        winding_number(places, asked, points, faces, at_once=8000)
    with LargestTensor() as free:
        winding_number(places, asked, points, faces, at_once=10**9)
    # The corners of a triangle have three coordinates each.
    assert bounded.numbers <= 3 * 8000
    assert free.numbers == 3 * 300 * len(faces)


def test_single_precision_tells_inside_from_outside(hand: HandModel) -> None:
    points, faces = capped(hand, random_vertices(hand, 2, spread=0.5).double())
    places, asked = 0.04 * torch.randn(400, 3, dtype=torch.float64), torch.arange(400) % 2
    exact = winding_number(places, asked, points, faces)
    # At the distance of a hand from a camera.
    away = torch.tensor([0.1, 0.1, 0.7], dtype=torch.float64)
    single = winding_number((places + away).float(), asked, (points + away).float(), faces)
    assert float((single - exact).abs().max()) < 1e-2


def test_has_no_gradient() -> None:
    vertices, faces = solid(trimesh.creation.icosphere())
    point = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    turns = winding_number(point, torch.tensor([0]), vertices.requires_grad_(), faces)
    assert not turns.requires_grad


def test_no_queries_are_no_answers() -> None:
    vertices, faces = solid(trimesh.creation.icosphere())
    none = winding_number(torch.zeros(0, 3).double(), torch.zeros(0).long(), vertices, faces)
    assert none.shape == (0,)


def test_a_bound_that_allows_nothing_is_refused() -> None:
    vertices, faces = solid(trimesh.creation.icosphere())
    with pytest.raises(ValueError, match="at least one solid angle, found 0"):
        winding_number(torch.zeros(1, 3).double(), torch.tensor([0]), vertices, faces, at_once=0)
