"""Closed forms of small matrices: against PyTorch's decompositions, and against numbers by hand."""

import pytest
import torch

from hand_recon.formats.onnx_matrices import closed_form, determinant, inverse, solution
from tests.support.tolerance import BATCH_SHAPES, assert_close


def matrices(*batch: int, side: int = 3) -> torch.Tensor:
    """Random matrices that are far from singular."""
    return torch.randn(*batch, side, side, dtype=torch.float64) + 4 * torch.eye(side)


def test_the_determinants_of_a_shear_and_of_a_camera_are_the_products_of_their_diagonals() -> None:
    camera = torch.tensor([[500.0, 3.0, 112.0], [0.0, 400.0, 90.0], [0.0, 0.0, 1.0]])
    assert determinant(camera).item() == 200_000
    assert determinant(torch.tensor([[2.0, 7.0], [0.0, 3.0]])).item() == 6


def test_the_inverse_of_a_camera_takes_pixels_to_rays() -> None:
    camera = torch.tensor([[500.0, 0.0, 112.0], [0.0, 250.0, 90.0], [0.0, 0.0, 1.0]])
    pixel = torch.tensor([[612.0], [340.0], [1.0]])
    assert_close(inverse(camera) @ pixel, torch.ones(3, 1))
    assert_close(solution(camera, pixel), torch.ones(3, 1))


@pytest.mark.parametrize("batch", BATCH_SHAPES)
def test_agree_with_decompositions(batch: tuple[int, ...]) -> None:
    square, right = matrices(*batch), torch.randn(*batch, 3, 2, dtype=torch.float64)
    assert_close(determinant(square), torch.linalg.det(square))
    assert_close(inverse(square), torch.linalg.inv(square))
    assert_close(solution(square, right), torch.linalg.solve(square, right))
    small = matrices(*batch, side=2)
    assert_close(determinant(small), torch.linalg.det(small))


def test_inside_the_context_alone_pytorchs_functions_are_replaced() -> None:
    square = matrices(side=4)
    expected = torch.linalg.inv(square)
    with closed_form(), pytest.raises(ValueError, match=r"shape \(4, 4\).*expected 3 × 3"):
        torch.linalg.inv(square)
    with closed_form():
        three = matrices(5)
        assert torch.equal(torch.linalg.inv(three), inverse(three))
        assert torch.equal(torch.linalg.det(three), determinant(three))
        assert torch.equal(three.sum(), torch.sum(three))
    assert torch.equal(torch.linalg.inv(square), expected)


def test_a_determinant_of_four_rows_is_refused() -> None:
    with pytest.raises(ValueError, match="whose inverse is written in closed form"):
        determinant(matrices(side=4))
