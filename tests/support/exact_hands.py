"""Hands that fit their landmarks exactly, before a known camera, for the tests of verdicts."""

from dataclasses import replace

import torch
from torch import Tensor

from hand_recon.camera import project
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.verdict import DOUBTFUL, Verdict, verdicts
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from hand_recon.schema import HandParameters, HandPrediction

SIZE = (640, 480)
CAMERA = torch.tensor([[600.0, 0, 322], [0, 600, 239], [0, 0, 1]], dtype=torch.float64)
COUNT = 4


def parameters(count: int = COUNT) -> HandParameters:
    """Half-open hands with the palm towards the camera, each bent and rotated a little otherwise."""
    angles = torch.zeros(count, 15, 3)
    angles[..., AXES.index("bend")] = torch.linspace(0.2, 0.5, count)[:, None]
    facing = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    tilt = torch.linspace(-0.4, 0.4, count)
    rotation = torch.stack([_about_x(float(angle)) @ facing for angle in tilt])
    translation = torch.tensor([0.02, -0.01, 0.5]).repeat(count, 1)
    return HandParameters(angles, torch.zeros(count, 10), rotation, translation)


def _about_x(angle: float) -> Tensor:
    c, s = torch.tensor(angle).cos(), torch.tensor(angle).sin()
    return torch.tensor([[1.0, 0, 0], [0, float(c), -float(s)], [0, float(s), float(c)]])


def exact(
    hand: HandModel, found: HandParameters | None = None, *, left: bool = False
) -> FittedHands:
    """Hands that fit their landmarks exactly, with σ of one pixel and a known camera."""
    found = found or parameters()
    posed = hand.to_camera(found)
    count = len(found.shape)
    camera = CAMERA.expand(count, 3, 3)
    sign = torch.tensor([-1.0 if left else 1.0, 1.0, 1.0])
    seen = project((posed.landmarks * sign).double(), camera)
    landmarks = ImageLandmarks(
        seen.clone(), torch.ones(count, 21, dtype=torch.bool), torch.full((count,), left),
        tuple(str(number) for number in range(count)), intrinsics=camera.clone(),
    )  # fmt: skip
    prediction = HandPrediction(
        found, posed.vertices * sign, posed.joints * sign, posed.landmarks * sign, seen,
        torch.zeros(count, 21, 2), camera.clone(),
    )  # fmt: skip
    return FittedHands(landmarks, prediction, {}, torch.ones(count, dtype=torch.float64))


def with_points(hands: FittedHands, points: Tensor) -> FittedHands:
    """The same fit, to other landmarks."""
    return replace(hands, observed=replace(hands.observed, landmarks_2d=points))


def with_camera(hands: FittedHands, matrix: Tensor) -> FittedHands:
    """The same fit, with another known camera."""
    matrices = matrix.double().expand(len(hands), 3, 3).clone()
    return replace(hands, observed=replace(hands.observed, intrinsics=matrices))


def box_side(hands: FittedHands) -> Tensor:
    """Longer side of the landmarks' box, pixels."""
    points = hands.observed.landmarks_2d
    return (points.amax(dim=1) - points.amin(dim=1)).amax(dim=-1)


def judge(hands: FittedHands, size: tuple[int, int] | None = SIZE) -> list[Verdict]:
    return verdicts(hands, [size] * len(hands))


def assert_all_say(found: list[Verdict], text: str) -> None:
    """Fail unless every hand is doubtful for one reason alone, which has this text."""
    assert {verdict.value for verdict in found} == {DOUBTFUL}
    for verdict in found:
        assert len(verdict.reasons) == 1, verdict
        assert text in verdict.reasons[0]
