"""Three fitted hands before a known camera, and options that write few files of them."""

import dataclasses

import torch

from hand_recon.camera import default_intrinsics, project, six_d_to_rotation
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.fitted_hands import FittedHands, fitted_hands
from hand_recon.fitting.results import ResultOptions
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandParameters, HandPrediction

CAMERA = torch.tensor([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]], dtype=torch.float64)
"""Intrinsics of an image of 640×480 pixels."""

SMALL_RESULTS = ResultOptions(meshes=2, pictures=2, panel=48)
"""Meshes and overlays of two hands, 48 px wide."""

SIDES = ("right", "left", "right")
"""Sides of the three hands."""


def fitted(hand: HandModel, *, calibrated: bool = True, off: float = 0.0) -> FittedHands:
    """A fit of three hands at their observed positions, or `off` metres to the right; the third is unseen."""
    torch.manual_seed(4)
    angles = torch.rand(3, 15, 3) * torch.tensor([1.0, 0.1, 0.0])
    translation = torch.tensor([[0.02, 0.01, 0.5], [-0.03, 0.0, 0.6], [0.0, 0.0, 0.5]])
    parameters = HandParameters(
        angles, torch.zeros(3, 10), six_d_to_rotation(torch.randn(3, 6)), translation
    )
    left = torch.tensor([side == "left" for side in SIDES])
    sign = torch.where(left[:, None, None], torch.diag(torch.tensor([-1.0, 1, 1])), torch.eye(3))
    seen = project((hand.to_camera(parameters).landmarks @ sign).double(), CAMERA.expand(3, 3, 3))
    labelled = torch.ones(3, 21, dtype=torch.bool)
    labelled[0, 5], labelled[2] = False, False
    seen[~labelled] = torch.nan
    observed = ImageLandmarks(
        seen, labelled, left, ("a b.jpg", "b/c.png", "third"), intrinsics=CAMERA.expand(3, 3, 3)
    )
    crops = to_crops(observed)
    moved = dataclasses.replace(parameters, translation=translation + torch.tensor([off, 0.0, 0.0]))
    posed = hand.to_camera(moved)
    camera = crops.batch.intrinsics
    assert camera is not None
    prediction = HandPrediction(
        moved, posed.vertices, posed.joints, posed.landmarks, project(posed.landmarks, camera),
        torch.full((3, 21, 2), 2.0).log(), camera,
    )  # fmt: skip
    if not calibrated:
        observed = dataclasses.replace(observed, intrinsics=None)
        crops = to_crops(observed)
        assumed = default_intrinsics(224, translation).expand(3, 3, 3)
        prediction = dataclasses.replace(
            prediction, intrinsics=assumed, landmarks_2d=project(posed.landmarks, assumed)
        )
    loss = {"data": torch.tensor([1.0, 3.0, torch.nan]), "pose": torch.zeros(3)}
    return fitted_hands(observed, crops, prediction, loss)
