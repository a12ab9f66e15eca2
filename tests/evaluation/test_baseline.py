"""Mean hand: independent of the hands' positions and orientations."""

import pytest
import torch
from torch import Tensor

from hand_recon.evaluation.alignment import align_proper
from hand_recon.evaluation.baseline import mean_pose_baseline, procrustes_mean
from hand_recon.evaluation.point_error import point_errors
from hand_recon.evaluation.scores import HandPoints
from tests.support.tolerance import assert_close


def moved(points: Tensor) -> Tensor:
    """Every hand randomly rotated and translated."""
    rotation = torch.linalg.qr(torch.randn(len(points), 3, 3).double())[0]
    rotation = rotation * torch.linalg.det(rotation)[:, None, None]
    return points @ rotation + torch.randn(len(points), 1, 3)


def variants(count: int, noise: float = 0.01) -> Tensor:
    hand = torch.randn(21, 3).double() * torch.tensor([0.08, 0.03, 0.02])
    return hand + noise * torch.randn(count, 21, 3)


def test_the_mean_of_one_hand_in_several_orientations_is_that_hand() -> None:
    hand = variants(1)
    mean = procrustes_mean(moved(hand.expand(5, -1, -1)))
    torch.testing.assert_close(align_proper(hand[0], mean), hand[0], rtol=0, atol=1e-7)
    size = torch.linalg.matrix_norm(hand[0] - hand[0].mean(dim=0))
    assert_close(torch.linalg.matrix_norm(mean), size)


def test_the_mean_has_the_first_hands_orientation() -> None:
    hands = variants(1)
    assert_close(procrustes_mean(hands), hands[0] - hands[0].mean(dim=0))


def test_the_size_is_the_mean_of_the_sizes() -> None:
    hand = variants(1)
    mean = procrustes_mean(torch.cat([hand, 3 * hand]))
    assert_close(mean, 2 * (hand[0] - hand[0].mean(dim=0)))


def test_positions_and_orientations_of_the_hands_do_not_matter() -> None:
    hands = variants(30)
    mean, other = procrustes_mean(hands), procrustes_mean(moved(hands))
    torch.testing.assert_close(align_proper(mean, other), mean, rtol=0, atol=1e-7)


def test_no_hand_is_as_near_to_all_as_the_mean() -> None:
    hands = variants(30)
    mean = procrustes_mean(hands)

    def cost(candidate: Tensor) -> Tensor:
        return point_errors(hands, align_proper(hands, candidate.expand_as(hands))).square().sum()

    assert all(cost(mean) < cost(hand) for hand in hands)


def test_the_surface_follows_the_landmarks() -> None:
    landmarks = variants(10)
    surface = landmarks[:, :5] + torch.tensor([0.0, 0.01, 0.0])
    both = moved(torch.cat([landmarks, surface], dim=1))
    baseline = mean_pose_baseline(HandPoints(both[:, :21], both[:, 21:]))
    assert baseline.vertices is not None
    assert baseline.vertices.shape == (1, 5, 3)
    assert_close(baseline.landmarks, mean_pose_baseline(HandPoints(both[:, :21])).landmarks)
    # Ten millimetres, except for the different orientations of the random hands.
    offset = (baseline.vertices - baseline.landmarks[:, :5]).norm(dim=-1)
    torch.testing.assert_close(offset, torch.full_like(offset, 0.01), rtol=0.05, atol=0)


@pytest.mark.parametrize("broken", [0.0, float("nan")])
def test_hands_without_extent_are_counted_and_refused(broken: float) -> None:
    hands = variants(3)
    hands[1] = broken
    with pytest.raises(ValueError, match="1 of 3 hands have no extent or a NaN"):
        procrustes_mean(hands)


def test_no_hands_have_no_mean() -> None:
    with pytest.raises(ValueError, match=r"0 of 0 hands .* at least one"):
        procrustes_mean(torch.zeros(0, 21, 3))
