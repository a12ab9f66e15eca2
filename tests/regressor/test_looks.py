"""Several looks at turned crops."""

import math

import pytest
import torch
from torch import Tensor

from hand_recon.regressor.looks import Look, look_around

SIZE = 48
POINTS = [(24.0, 10.0), (33.5, 21.5), (14.5, 30.5)]


def assert_near(actual: Tensor, expected: Tensor, by: float) -> None:
    torch.testing.assert_close(actual, expected, atol=by, rtol=0)


def picture(points: list[tuple[float, float]]) -> Tensor:
    """A crop with a smooth dot at each point: brightest in red, then green, then blue."""
    centres = torch.arange(SIZE) + 0.5
    dots = [
        torch.exp(-((centres[:, None] - y) ** 2 + (centres - x) ** 2) / 2 / 2.0**2)
        for x, y in points
    ]
    return torch.stack(dots)[None]


def middles(images: Tensor) -> Tensor:
    """Middles of the three dots, seven times each, pixels."""
    centres = torch.arange(SIZE) + 0.5
    mass = images.sum(dim=(-2, -1))
    across = (images.sum(dim=-2) * centres).sum(dim=-1) / mass
    down = (images.sum(dim=-1) * centres).sum(dim=-1) / mass
    return torch.stack([across, down], dim=-1).repeat(1, 7, 1)


class Looker:
    """Finds the dots, is surest of a hand that points up, and counts its looks."""

    def __init__(self, error: float = 0.0) -> None:
        self.error = error
        self.angles: list[Tensor] = []

    def __call__(self, images: Tensor) -> Look:
        points = middles(images)
        ahead = points[:, 0] - points[:, 1:3].mean(dim=1)
        angle = torch.atan2(ahead[:, 0], -ahead[:, 1]).abs()
        self.angles.append(angle)
        spread = (0.1 + angle)[:, None].expand(-1, points.shape[1])
        moved = points + torch.tensor([self.error, 0.0])
        return Look(moved, spread, angle[:, None])


def test_hands_of_every_right_angle_are_found_where_they_are() -> None:
    upright = picture(POINTS)
    images = torch.cat([torch.rot90(upright, quarter, (-2, -1)) for quarter in range(4)])
    seen = look_around(Looker(), images, [-20.0, 20.0])
    assert_near(seen.landmarks, middles(images), 0.05)


def test_the_surest_look_gives_spread_and_summary() -> None:
    upright = picture(POINTS)
    images = torch.cat([torch.rot90(upright, quarter, (-2, -1)) for quarter in range(4)])
    straight = Looker()(upright)
    seen = look_around(Looker(), images, [])
    assert_near(seen.spread, straight.spread.expand(4, -1), 1e-4)
    assert_near(seen.summary, straight.summary.expand(4, -1), 1e-4)


def test_further_looks_are_at_the_surest_crop_turned() -> None:
    looker = Looker()
    look_around(looker, torch.rot90(picture(POINTS), 1, (-2, -1)), [-20.0, 30.0])
    straight = Looker()(picture(POINTS)).summary.item()
    angles = torch.cat(looker.angles)
    assert len(angles) == 6
    # The hand points 4° to the right of up (from x towards y), the further looks 16° to the left and 34°.
    assert angles[4].item() == pytest.approx(math.radians(20) - straight, abs=0.02)
    assert angles[5].item() == pytest.approx(math.radians(30) + straight, abs=0.02)


def test_errors_of_a_fixed_direction_cancel_in_part() -> None:
    images = picture(POINTS)
    one = look_around(Looker(error=3.0), images, []).landmarks - middles(images)
    three = look_around(Looker(error=3.0), images, [-20.0, 20.0]).landmarks - middles(images)
    assert_near(one, torch.tensor([3.0, 0.0]).expand(1, 21, 2), 1e-3)
    # The mean of an error of 3 px in three directions: 3 (1 + 2 cos 20°) / 3.
    expected = torch.tensor([1 + 2 * math.cos(math.radians(20)), 0.0]).expand(1, 21, 2)
    assert_near(three, expected, 0.05)


def test_crops_alike_in_every_turn_are_seen_as_they_are() -> None:
    def blind(images: Tensor) -> Look:
        points = torch.tensor([5.0, 9.0]).expand(len(images), 21, 2)
        return Look(points, torch.ones(len(images), 21), images.mean(dim=(-2, -1)))

    seen = look_around(blind, torch.rand(2, 3, SIZE, SIZE), [])
    assert_near(seen.landmarks, torch.tensor([5.0, 9.0]).expand(2, 21, 2), 1e-5)
