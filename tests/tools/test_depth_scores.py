"""Errors of the measurement of depth, and their means and intervals over groups."""

import pytest
import torch

from depth.scores import aligned_errors, grouped_mean, second_view_errors
from hand_recon.camera import project
from hand_recon.hand.model import HandModel
from tests.support.second_camera import ROTATION, second
from tests.support.views import known_hands


@pytest.fixture
def points(hand: HandModel) -> torch.Tensor:
    return hand.to_camera(known_hands(hand, 6)).landmarks.double()


def test_a_hand_that_is_larger_and_farther_away_is_met_by_the_second_camera(
    points: torch.Tensor,
) -> None:
    for scale in (1.0, 0.8, 1.3):
        assert second_view_errors(scale * points, second(points)).max() < 1e-3


def test_a_hand_flipped_in_depth_is_seen_by_the_second_camera(points: torch.Tensor) -> None:
    flipped = points.clone()
    flipped[..., 2] = 2 * points[:, :1, 2] - points[..., 2]
    assert second_view_errors(flipped, second(points)).min() > 5


def test_the_second_cameras_scale_is_the_best_of_many(points: torch.Tensor) -> None:
    camera = second(points)
    found = points + 0.01 * torch.randn_like(points)
    scales = torch.linspace(0.7, 1.4, 2001, dtype=torch.float64)
    cameras = camera.intrinsics.expand(6, 3, 3)
    off = torch.stack(
        [
            project(scale * found @ ROTATION.mT + camera.translation, cameras) - camera.landmarks_2d
            for scale in scales
        ]
    )
    least = off.square().sum(dim=(-2, -1)).argmin(dim=0)
    expected = off.norm(dim=-1).mean(dim=-1)[least, torch.arange(6)]
    torch.testing.assert_close(second_view_errors(found, camera), expected, rtol=1e-2, atol=1e-2)


def test_errors_are_millimetres_after_a_similarity(points: torch.Tensor) -> None:
    moved = 2 * points @ ROTATION + 1
    # The benchmarks add 1e-8 to each norm.
    assert aligned_errors(points, moved).max() < 1e-4
    off = points.clone()
    off[:, 8] += torch.tensor([0.0, 0.0, 0.021])
    errors = aligned_errors(points, off)
    assert (errors.argmax(dim=1) == 8).all()
    # The alignment is one of least squares: without it, one landmark is 21 mm off and the others none.
    assert (errors.square().sum(dim=1) < 21**2).all()


def test_an_interval_over_groups_is_wider_than_over_single_hands() -> None:
    """Ten hands of each group are copies of one number."""
    values = torch.arange(8.0).repeat_interleave(10)
    groups = [str(number // 10) for number in range(80)]
    together = grouped_mean(values, groups)
    apart = grouped_mean(values, [str(number) for number in range(80)])
    assert together.value == apart.value == pytest.approx(3.5)
    widths = [each.interval.high - each.interval.low for each in (together, apart)]
    # Of means of 8 and of 80 numbers: √10 times as wide.
    assert widths[0] / widths[1] == pytest.approx(10**0.5, rel=0.1)


def test_groups_of_different_sizes_count_by_their_hands() -> None:
    values = torch.tensor([0.0, 3.0, 3.0, 3.0])
    found = grouped_mean(values, ["a", "b", "b", "b"])
    assert found.value == pytest.approx(2.25)
    assert (found.interval.low, found.interval.high) == pytest.approx((0.0, 3.0))
