"""3D labels for a share of the hands: the choice, the loss, and hands without label."""

import itertools
from dataclasses import replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.schema import HandBatch, HandParameters, HandPrediction
from hand_recon.training.supervision import Landmarks3D
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

SET = torch.arange(20_000)
"""Positions in a dataset as large as the lifter's."""


@pytest.fixture
def seen(hand: HandModel) -> HandBatch:
    return views(hand, known_hands(hand, 4))


def predicted(batch: HandBatch, off: torch.Tensor) -> HandPrediction:
    """The ground truth plus an error of each landmark, metres."""
    assert batch.landmarks_3d is not None
    assert batch.intrinsics is not None
    count = len(batch)
    landmarks = batch.landmarks_3d + off
    parameters = HandParameters(
        torch.zeros(count, 15, 3), torch.zeros(count, 10), torch.eye(3).expand(count, 3, 3),
        torch.zeros(count, 3),
    )  # fmt: skip
    return HandPrediction(
        parameters, landmarks, landmarks[:, :16], landmarks, batch.landmarks_2d,
        torch.zeros(count, 21, 2), batch.intrinsics,
    )  # fmt: skip


def test_two_landmarks_two_and_three_centimetres_off_cost_their_squares(seen: HandBatch) -> None:
    off = torch.zeros(4, 21, 3)
    off[1, 4, 2] = 0.02
    off[1, 8, 0] = -0.03
    loss = Landmarks3D()(seen, predicted(seen, off))
    torch.testing.assert_close(loss, torch.tensor([0, 0.0013, 0, 0]), atol=1e-7, rtol=1e-4)


def test_where_the_hand_is_does_not_count_but_its_root_does(seen: HandBatch) -> None:
    """Errors are about the middle finger's MCP: if that alone is off, all twenty others are."""
    shifted = Landmarks3D()(seen, predicted(seen, torch.tensor([0.3, -0.1, 0.2])))
    assert shifted.max() < 1e-10
    off = torch.zeros(4, 21, 3)
    off[:, ROOT_LANDMARK, 1] = 0.01
    expected = torch.full((4,), 20 * 0.01**2)
    torch.testing.assert_close(
        Landmarks3D()(seen, predicted(seen, off)), expected, rtol=1e-4, atol=0
    )


def test_ten_millimetres_everywhere_weigh_as_five_pixels_do(seen: HandBatch) -> None:
    """21 landmarks · 100 mm² · 0.5 per mm² = 1050 = 21 · 2 · 5² px²."""
    off = torch.randn(4, 21, 3)
    off = 0.01 * off / off.norm(dim=-1, keepdim=True)
    off[:, ROOT_LANDMARK] = 0.0
    supervision = Landmarks3D()
    weighted = supervision.weight * supervision(seen, predicted(seen, off))
    torch.testing.assert_close(
        weighted, torch.full((4,), 21 * 2 * 5.0**2 * 20 / 21), rtol=1e-3, atol=0
    )


@pytest.mark.parametrize("fraction", [0.01, 0.1, 0.5, 0.9])
def test_about_the_share_that_was_asked_for_is_chosen(fraction: float) -> None:
    chosen = Landmarks3D(fraction).chosen(SET)
    assert float(chosen.float().mean()) == pytest.approx(fraction, rel=0.05)
    # Spread over the whole set, because consecutive frames of a recording are similar.
    for part in chosen.chunk(10):
        assert float(part.float().mean()) == pytest.approx(fraction, rel=0.25)


def test_the_choice_is_fixed_and_smaller_shares_lie_in_larger_ones() -> None:
    shares = (0.0, 0.1, 0.5, 1.0)
    chosen = [Landmarks3D(fraction).chosen(SET) for fraction in shares]
    assert not chosen[0].any()
    assert chosen[3].all()
    for smaller, larger in itertools.pairwise(chosen):
        assert (larger | ~smaller).all()
    # By index in the dataset alone: the same hands in any order, batch or run.
    order = torch.randperm(len(SET))
    assert torch.equal(Landmarks3D(0.1).chosen(SET[order]), chosen[1][order])
    assert torch.equal(Landmarks3D(0.1).chosen(SET[:64]), chosen[1][:64])


def test_hands_that_are_not_chosen_cost_nothing_and_pull_nothing(seen: HandBatch) -> None:
    supervision = Landmarks3D(0.5)
    index = torch.cat([SET[supervision.chosen(SET)][:2], SET[~supervision.chosen(SET)][:2]])
    batch = replace(seen, index=index)
    leaf = torch.full((4, 21, 3), 0.01, requires_grad=True)
    shape = torch.linspace(-1, 1, 21)[:, None]
    loss = supervision(batch, predicted(batch, leaf * shape))
    loss.sum().backward()
    assert (loss[:2] > 0).all()
    assert (loss[2:] == 0).all()
    assert leaf.grad is not None
    assert leaf.grad[2:].count_nonzero() == 0
    assert leaf.grad[:2].count_nonzero() > 0


def test_a_hand_without_truth_is_masked_in_value_and_gradient(seen: HandBatch) -> None:
    assert seen.landmarks_3d is not None
    ground_truth = seen.landmarks_3d.clone()
    ground_truth[2] = torch.nan
    ground_truth[3, 5, 1] = torch.nan
    leaf = torch.randn(4, 21, 3).requires_grad_()
    prediction = predicted(seen, 0.01 * leaf)
    loss = Landmarks3D()(replace(seen, landmarks_3d=ground_truth), prediction)
    loss.sum().backward()
    assert (loss[:2] > 0).all()
    assert (loss[2:] == 0).all()
    assert leaf.grad is not None
    assert leaf.grad.isfinite().all()
    assert leaf.grad[2:].count_nonzero() == 0


def test_gradient_matches_finite_differences(seen: HandBatch) -> None:
    assert seen.landmarks_3d is not None
    batch = replace(seen, landmarks_3d=seen.landmarks_3d.double()).select(slice(2))
    off = (0.01 * torch.randn(2, 21, 3, dtype=torch.float64)).requires_grad_()
    supervision = Landmarks3D()
    assert torch.autograd.gradcheck(lambda off: supervision(batch, predicted(batch, off)), off)


def test_data_without_3d_labels_are_refused_with_the_cure(seen: HandBatch) -> None:
    prediction = predicted(seen, torch.zeros(4, 21, 3))
    with pytest.raises(ValueError, match="supervision=landmarks_2d"):
        Landmarks3D()(replace(seen, landmarks_3d=None), prediction)


@pytest.mark.parametrize("fraction", [-0.1, 1.5])
def test_more_than_all_is_no_share(fraction: float) -> None:
    with pytest.raises(ValueError, match=f"share of the hands.*found fraction={fraction}"):
        Landmarks3D(fraction)


def test_a_share_of_all_is_the_default() -> None:
    assert Landmarks3D().fraction == 1.0
    assert_close(torch.tensor(Landmarks3D().weight), torch.tensor(500_000.0))
