"""A lifter's prediction follows rotation and scale of a crop, and its σ is in the crop's pixels."""

import math

import pytest
import torch

from hand_recon.camera import default_intrinsics, project
from hand_recon.fitting.lift import carried_start, lift, lifted_start, position_of
from hand_recon.fitting.observation import Observation
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

COUNT = 6


@pytest.fixture
def lifter(hand: HandModel) -> Regressor:
    encoder = LandmarkEncoder(width=32, depth=1)
    network = Regressor(encoder, hand, width=32, dropout=0.0, activation=True, reprojection=True)
    with torch.no_grad():
        # Away from the initial hand: a prediction that depends on the landmarks.
        for parameter in network.decoders.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
    return network.eval()


@pytest.fixture
def seen(hand: HandModel) -> Observation:
    batch = views(hand, known_hands(hand, COUNT))
    camera = default_intrinsics(224, batch.landmarks_2d).expand(COUNT, 3, 3)
    return Observation(batch.landmarks_2d, batch.labelled, camera)


def moved(seen: Observation, linear: torch.Tensor) -> Observation:
    """The landmarks rotated or scaled about the middle of the crop."""
    landmarks = (seen.landmarks_2d - 112) @ linear.mT + 112
    return Observation(landmarks, seen.labelled, seen.intrinsics)


def test_a_rotated_crop_gives_the_rotated_hand(lifter: Regressor, seen: Observation) -> None:
    angle = 0.7
    rotation = torch.eye(3)
    rotation[:2, :2] = torch.tensor(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    )
    alone, rotated = lift(lifter, seen), lift(lifter, moved(seen, rotation[:2, :2]))
    assert_close(rotated.landmarks_3d, alone.landmarks_3d @ rotation.mT)
    assert_close(rotated.parameters.joint_angles, alone.parameters.joint_angles)


def test_sigma_is_in_pixels_of_the_crop(lifter: Regressor, seen: Observation) -> None:
    alone, half = lift(lifter, seen), lift(lifter, moved(seen, 0.5 * torch.eye(2)))
    assert_close(half.log_sigma, alone.log_sigma - math.log(2))


def test_a_start_is_the_answer(lifter: Regressor, seen: Observation) -> None:
    answer, start = lift(lifter, seen).parameters, lifted_start(lifter, seen)
    assert start.shape.shape == (COUNT, 1, 10)
    assert_close(start.joint_angles[:, 0], answer.joint_angles)
    assert_close(start.root_rotation[:, 0], answer.root_rotation)
    assert_close(start.translation[:, 0], answer.translation)
    assert_close(start.shape[:, 0], answer.shape)


def test_a_position_is_found_again_in_any_camera(hand: HandModel) -> None:
    """Exact projections of known points determine the translation, also with landmarks missing."""
    posed = hand.to_camera(known_hands(hand, COUNT))
    camera = torch.tensor([[700.0, 0.0, 90.0], [0.0, 650.0, 140.0], [0.0, 0.0, 1.0]])
    cameras = camera.expand(COUNT, 3, 3)
    moved_by = posed.landmarks.mean(dim=1) + torch.tensor([0.1, -0.05, 0.3])
    points = posed.landmarks - posed.landmarks.mean(dim=1, keepdim=True)
    pixels = project(points + moved_by[:, None], cameras)
    labelled = torch.ones(COUNT, 21, dtype=torch.bool)
    labelled[:, 3:17] = False
    pixels[:, 3:17] = torch.nan
    found = position_of(points, pixels, labelled, cameras)
    torch.testing.assert_close(found, moved_by, atol=1e-3, rtol=0)


@pytest.mark.parametrize("with_shape", [False, True])
def test_a_carried_start_is_at_its_landmarks(
    lifter: Regressor, seen: Observation, hand: HandModel, *, with_shape: bool
) -> None:
    own = lifted_start(lifter, seen)
    start = carried_start(hand.landmarks_only(), lifter, seen, with_shape=with_shape)
    assert_close(start.joint_angles, own.joint_angles)
    assert_close(start.root_rotation, own.root_rotation)
    assert torch.equal(start.shape, own.shape if with_shape else torch.zeros_like(own.shape))
    posed = hand(start.joint_angles[:, 0], start.shape[:, 0]).landmarks

    def squares(translation: torch.Tensor) -> torch.Tensor:
        """Squared distances on the landmarks' rays, which the position makes least."""
        placed = posed @ start.root_rotation[:, 0].mT + translation
        rays = (seen.landmarks_2d - seen.intrinsics[:, None, :2, 2]) / 500
        off = placed[..., :2] - rays * placed[..., 2:]
        return off.square().sum(dim=(1, 2))

    least = squares(start.translation)
    for step in 0.01 * torch.cat([torch.eye(3), -torch.eye(3)]):
        assert bool((squares(start.translation + step) > least).all())


def test_a_prediction_has_the_landmarks_that_were_asked_for(
    lifter: Regressor, seen: Observation
) -> None:
    """The same hand, with the landmarks of another set on it."""
    own, other = lift(lifter, seen), lift(lifter, seen, open_hand("mano"))
    assert_close(other.vertices, own.vertices)
    assert_close(other.landmarks_3d[:, 0], own.landmarks_3d[:, 0])
    assert float((other.landmarks_3d - own.landmarks_3d).norm(dim=-1).max()) > 0.005
