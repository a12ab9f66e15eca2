"""Jitter and bone lengths over time."""

from dataclasses import replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.plausibility.given_hands import of_points
from hand_recon.plausibility.posed_hands import posed_hands
from hand_recon.plausibility.sequences import SequenceFindings, sequence_findings
from tests.support.audited_hands import bent, models_of, points_of

FRAMES = 8


def measured(
    hand: HandModel, points: torch.Tensor, times: torch.Tensor | None = None
) -> SequenceFindings:
    count = len(points)
    given = of_points(points, "clip", left=[False] * count)
    times = torch.arange(count) / 10 if times is None else times
    given = replace(given, sequences=("clip",) * count, times=times)
    (found,) = sequence_findings(posed_hands(given, models_of(hand)))
    return found


def test_constant_acceleration_is_the_jitter(hand: HandModel) -> None:
    """½ · 2 m/s² · t² along one axis: 2,000 mm/s², and no bone changes."""
    still = points_of(hand, bent(index_PIP_bend=30)).expand(FRAMES, -1, -1)
    times = torch.arange(FRAMES) / 10
    moved = still + times.square()[:, None, None] * torch.tensor([1.0, 0.0, 0.0])
    found = measured(hand, moved)
    assert found.frames == FRAMES
    assert found.jitter == pytest.approx(2000, rel=1e-3)
    assert found.bone_variation == pytest.approx(0.0, abs=1e-2)


def test_frames_out_of_order_are_sorted_by_time(hand: HandModel) -> None:
    still = points_of(hand, bent()).expand(FRAMES, -1, -1)
    order = torch.randperm(FRAMES)
    times = torch.arange(FRAMES)[order] / 10
    moved = still + times[:, None, None] * torch.tensor([0.0, 0.3, 0.0])
    # Constant velocity has no acceleration, whatever the order of the rows.
    assert measured(hand, moved, times).jitter == pytest.approx(0.0, abs=0.5)


def test_a_bone_that_changes_by_a_tenth_is_named(hand: HandModel) -> None:
    """Lengths 0.9 and 1.1 in turn: a standard deviation of 10 % of the mean."""
    points = points_of(hand, bent()).repeat(FRAMES, 1, 1)
    tip, before = (LANDMARKS.index(f"ring {part}") for part in ("tip", "DIP"))
    factor = torch.tensor([0.9, 1.1]).repeat(FRAMES // 2)[:, None]
    points[:, tip] = points[:, before] + factor * (points[:, tip] - points[:, before])
    found = measured(hand, points)
    assert found.bone == "ring tip"
    assert found.bone_variation == pytest.approx(10.0, rel=1e-3)


def test_one_persons_hands_have_no_times_and_no_jitter(hand: HandModel) -> None:
    points = points_of(hand, bent()).repeat(3, 1, 1)
    found = measured(hand, points, torch.full((3,), torch.nan))
    assert found.jitter != found.jitter
    assert found.bone_variation == pytest.approx(0.0, abs=1e-3)


def test_single_hands_are_no_sequence(hand: HandModel) -> None:
    given = of_points(points_of(hand, bent()), "one", left=[False])
    assert sequence_findings(posed_hands(given, models_of(hand))) == []
