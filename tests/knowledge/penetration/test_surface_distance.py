"""The nearest point of a triangle."""

import pytest
import torch
import trimesh
from torch import Tensor

from hand_recon.knowledge.penetration.surface_distance import nearest_on_triangles
from tests.support.tolerance import BATCH_SHAPES, assert_close

TRIANGLE = torch.tensor([[0, 0, 0], [4, 0, 0], [0, 4, 0]], dtype=torch.float64)


@pytest.mark.parametrize(
    ("point", "weights"),
    [
        ([1, 1, 5], [0.5, 0.25, 0.25]),  # Above the inside.
        ([2, -3, 1], [0.5, 0.5, 0]),  # Beside each side.
        ([-3, 1, 0], [0.75, 0, 0.25]),
        ([5, 5, 0], [0, 0.5, 0.5]),
        ([-1, -2, 0], [1, 0, 0]),  # Beyond each corner.
        ([9, -1, 2], [0, 1, 0]),
        ([-1, 9, 2], [0, 0, 1]),
        ([0, 4, 0], [0, 0, 1]),  # On a corner.
    ],
)
def test_the_nearest_point_by_hand(point: list[float], weights: list[float]) -> None:
    actual = nearest_on_triangles(torch.tensor(point, dtype=torch.float64), TRIANGLE)
    assert_close(actual, torch.tensor(weights, dtype=torch.float64))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_agrees_with_trimesh(shape: tuple[int, ...]) -> None:
    points = torch.randn(*shape, 200, 3, dtype=torch.float64)
    triangles = torch.randn(*shape, 200, 3, 3, dtype=torch.float64)
    weights = nearest_on_triangles(points, triangles)
    nearest = (weights[..., None] * triangles).sum(dim=-2)
    expected = trimesh.triangles.closest_point(  # type: ignore[no-untyped-call]
        triangles.reshape(-1, 3, 3).numpy(), points.reshape(-1, 3).numpy()
    )
    assert_close(weights.sum(dim=-1), torch.ones(()).expand(*shape, 200))
    assert_close(nearest.reshape(-1, 3), torch.from_numpy(expected))


@pytest.mark.parametrize(
    "flat",
    [
        torch.zeros(3, 3),
        torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]),
        torch.tensor([[0.0, 0, 0], [0, 0, 0], [2, 0, 0]]),
    ],
)
def test_a_triangle_without_area_is_its_sides(flat: Tensor) -> None:
    weights = nearest_on_triangles(torch.tensor([0.5, 1, 0]), flat)
    reached = weights @ flat
    assert torch.isfinite(weights).all()
    assert_close(reached, torch.tensor([0.5 * bool(flat.any()), 0, 0]))
