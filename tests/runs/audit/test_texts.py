"""Hands in JSON, as an audit reads them."""

import json
from pathlib import Path

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.plausibility.given_hands import GivenHands
from hand_recon.runs.audit.sources import Reading, read_given
from tests.support.audited_hands import natural_angles, points_of


@pytest.fixture(scope="module")
def points(hand: HandModel) -> torch.Tensor:
    return points_of(hand, natural_angles(1))


def read(hand: HandModel, path: Path) -> GivenHands:
    return read_given([path], hand, None, Reading())


def test_one_hand_and_files_that_begin_with_a_byte_order_mark(
    hand: HandModel, points: torch.Tensor, tmp_path: Path
) -> None:
    (tmp_path / "one.json").write_text(json.dumps(points[0].tolist()))
    assert torch.allclose(read(hand, tmp_path / "one.json").points, points[:1], atol=1e-6)
    hands = [{"landmarks": points[0].tolist(), "side": "left"}]
    (tmp_path / "objects.json").write_text(json.dumps(hands), encoding="utf-8-sig")
    found = read(hand, tmp_path / "objects.json")
    assert torch.allclose(found.points, points[:1], atol=1e-6)
    assert found.left == (True,)


def test_points_as_objects_are_refused(hand: HandModel, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(
        json.dumps([{"landmarks": [{"x": 0.1, "y": 0.2, "z": 0.3}] * 21}])
    )
    with pytest.raises(
        ValueError, match=r"points that are objects; expected a list of three numbers"
    ):
        read(hand, tmp_path / "a.json")
