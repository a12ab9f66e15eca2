"""Maps of landmarks: mean positions and spreads against hand-computed ones, shifts, gradients."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.regressor.landmark_maps import REACH, LandmarkMaps, mean_positions
from tests.support.tolerance import assert_close


def test_a_sharp_map_gives_the_centre_of_its_cell() -> None:
    maps = torch.full((1, 1, 4, 8), -100.0)
    maps[0, 0, 1, 6] = 0.0
    position, spread = mean_positions(maps)
    assert_close(
        position[0, 0], torch.tensor([0.5 + REACH * (6.5 / 8 - 0.5), 0.5 + REACH * (1.5 / 4 - 0.5)])
    )
    assert float(spread) == pytest.approx(1e-4)


def test_two_equal_cells_give_their_middle_and_half_their_distance() -> None:
    maps = torch.full((1, 1, 4, 4), -100.0)
    maps[0, 0, 0, 0] = maps[0, 0, 0, 2] = 3.0
    position, spread = mean_positions(maps)
    assert float(position[0, 0, 0]) == pytest.approx(0.5 + REACH * (1.5 / 4 - 0.5))
    assert float(spread) == pytest.approx(REACH / 4)


def test_an_empty_map_gives_the_middle_of_the_crop() -> None:
    position, _ = mean_positions(torch.zeros(2, 3, 5, 5))
    assert_close(position, torch.full((2, 3, 2), 0.5))


@given(st.integers(0, 2), st.integers(0, 2))
def test_a_shifted_map_shifts_its_landmark(down: int, across: int) -> None:
    maps = torch.full((1, 1, 8, 8), -100.0)
    maps[..., 2:5, 2:5] = torch.randn(3, 3)
    first, spread = mean_positions(maps)
    second, same = mean_positions(maps.roll((down, across), (-2, -1)))
    assert_close(second - first, REACH / 8 * torch.tensor([[[float(across), float(down)]]]))
    assert_close(spread, same)


def test_gradients_of_positions() -> None:
    maps = torch.randn(1, 2, 3, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda values: mean_positions(values), maps)


def test_sizes_that_are_no_multiples_of_the_strides() -> None:
    network = LandmarkMaps({8: 4, 16: 6, 32: 8}, width=8)
    features = {
        stride: torch.randn(2, channels, *(2 * [-(-112 // stride)]))
        for stride, channels in ((8, 4), (16, 6), (32, 8))
    }
    position, spread = network(features)
    assert position.shape == (2, 21, 2)
    assert spread.shape == (2, 21)
