"""A batch of two hands to draw."""

from dataclasses import replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandPrediction
from tests.visualization import test_overlay


@pytest.fixture
def scene(hand: HandModel) -> tuple[HandBatch, HandPrediction]:
    """Two grey crops of 64 px with a hand predicted in the middle of each."""
    return test_overlay.scene(hand)


@pytest.fixture
def without_picture(scene: tuple[HandBatch, HandPrediction]) -> HandBatch:
    """The same landmarks alone, in crops of 224 px."""
    batch, _ = scene
    empty = torch.zeros(len(batch), 3, 0, 0, dtype=torch.uint8)
    return replace(batch, image=empty, landmarks_2d=batch.landmarks_2d * (224 / 64))
