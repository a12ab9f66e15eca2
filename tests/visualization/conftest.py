"""A batch of two hands to draw."""

from dataclasses import replace

import pytest
import torch

from hand_recon.camera import default_intrinsics, project
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandParameters, HandPrediction


@pytest.fixture
def scene(hand: HandModel) -> tuple[HandBatch, HandPrediction]:
    """Two grey crops of 64 px with a hand predicted in the middle of each."""
    rotation = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]).expand(2, 3, 3)
    translation = torch.tensor([0.0, 0.0, 0.6]).expand(2, 3)
    parameters = HandParameters(torch.zeros(2, 15, 3), torch.zeros(2, 10), rotation, translation)
    posed = hand.to_camera(parameters)
    camera = default_intrinsics(64, translation).expand(2, 3, 3)
    pixels = project(posed.landmarks, camera)
    labels, labelled = pixels.clone(), torch.ones(2, 21, dtype=torch.bool)
    labels[1, 4:], labelled[1, 4:] = float("nan"), False
    batch = HandBatch(
        torch.full((2, 3, 64, 64), 128, dtype=torch.uint8), labels, labelled,
        torch.arange(2), ("a", "b"),
    )  # fmt: skip
    prediction = HandPrediction(
        parameters, posed.vertices, posed.joints, posed.landmarks, pixels,
        torch.zeros(2, 21, 2), camera,
    )  # fmt: skip
    return batch, prediction


@pytest.fixture
def without_image(scene: tuple[HandBatch, HandPrediction]) -> HandBatch:
    """The same landmarks without images, in crops of 224 px."""
    batch, _ = scene
    empty = torch.zeros(len(batch), 3, 0, 0, dtype=torch.uint8)
    return replace(batch, image=empty, landmarks_2d=batch.landmarks_2d * (224 / 64))
