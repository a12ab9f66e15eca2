"""A network's estimate beside landmarks: carried to the fit, its start, and the result without steps."""

from dataclasses import replace

import pytest
import torch

from hand_recon.camera import project
from hand_recon.data.landmarks.crops import to_crops
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks, mirror
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.estimated import estimated_hands, estimated_start
from hand_recon.fitting.in_parts import fit_part
from hand_recon.fitting.objective import Fitted, Objective
from hand_recon.fitting.observation import Observation, observed
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.schema import HandEstimate, HandParameters
from hand_recon.uncertainty import NegativeLogLikelihood
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

CAMERA = torch.tensor([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])


def seen(hand: HandModel, count: int = 3) -> tuple[ImageLandmarks, HandParameters]:
    """Exact landmarks of known hands with the hands themselves as the estimate, σ of 2 px of the image."""
    parameters = known_hands(hand, count)
    batch = views(hand, parameters)
    assert batch.landmarks_3d is not None
    camera = CAMERA.expand(count, 3, 3)
    landmarks = ImageLandmarks(
        landmarks_2d=project(batch.landmarks_3d, camera).double(),
        labelled=batch.labelled,
        left=torch.zeros(count, dtype=torch.bool),
        names=tuple("abcdef"[:count]),
        intrinsics=camera.double(),
        estimate=HandEstimate(parameters, torch.full((count, 21, 2), 2.0).log().double()),
    )
    return landmarks, parameters


def test_an_estimate_follows_its_hand(hand: HandModel) -> None:
    landmarks, parameters = seen(hand)
    for which in (torch.tensor([2, 0]), torch.tensor([True, False, True]), slice(1, 3)):
        rows = torch.arange(3)[which]
        chosen = landmarks.select(which).estimate
        assert chosen is not None
        assert_close(chosen.parameters.shape, parameters.shape[rows])
    parts = [part.estimate for part in landmarks.parts(2)]
    assert [len(one.log_sigma) for one in parts if one is not None] == [2, 1]
    observation = observed(to_crops(landmarks).batch)[torch.tensor([1])]
    assert observation.estimate is not None
    assert_close(observation.estimate.parameters.translation, parameters.translation[1:2])
    assert landmarks.select(slice(0, 0)).estimate is not None


def test_sigma_of_an_estimate_is_scaled_with_the_crop_and_back(hand: HandModel) -> None:
    """A crop of 224 px shows 1.5 times a hand's extent: 2 px of the image are 2 · 224 / (1.5 · extent)."""
    landmarks, _ = seen(hand)
    crops = to_crops(landmarks)
    extent = landmarks.landmarks_2d.amax(dim=1) - landmarks.landmarks_2d.amin(dim=1)
    scale = 224 / (1.5 * extent.amax(dim=1))
    estimate = crops.batch.estimate
    assert estimate is not None
    assert_close(estimate.log_sigma.exp(), (2 * scale).float()[:, None, None].expand(3, 21, 2))
    found = fit_part(landmarks, lambda batch: Fitted(estimated_hands(observed(batch), hand), {}))
    assert_close(found.sigma_2d.float(), torch.full((3, 21, 2), 2.0))


def test_an_estimate_without_steps_is_the_hand_itself(hand: HandModel) -> None:
    landmarks, parameters = seen(hand)
    found = fit_part(landmarks, lambda batch: Fitted(estimated_hands(observed(batch), hand), {}))
    assert float((found.prediction.landmarks_2d - landmarks.landmarks_2d).abs().max()) < 1e-2
    assert_close(found.prediction.parameters.translation, parameters.translation)
    assert found.fitted.all()


def test_the_estimate_of_a_left_hand_is_that_of_its_mirror_image(hand: HandModel) -> None:
    landmarks, parameters = seen(hand)
    left = mirror(landmarks, torch.ones(3, dtype=torch.bool))
    found = fit_part(left, lambda batch: Fitted(estimated_hands(observed(batch), hand), {}))
    assert float((found.prediction.landmarks_2d - left.landmarks_2d).abs().max()) < 1e-2
    mirrored = parameters.translation * torch.tensor([-1.0, 1.0, 1.0])
    assert_close(found.prediction.parameters.translation, mirrored)


def test_a_hand_with_too_few_landmarks_needs_no_estimate(hand: HandModel) -> None:
    landmarks, parameters = seen(hand)
    labelled = landmarks.labelled.clone()
    labelled[1, 3:] = False
    assert landmarks.estimate is not None
    unknown = landmarks.estimate.log_sigma.clone()
    unknown[1] = torch.nan
    missing = replace(landmarks, labelled=labelled, estimate=HandEstimate(parameters, unknown))
    found = fit_part(missing, lambda batch: Fitted(estimated_hands(observed(batch), hand), {}))
    assert found.fitted.tolist() == [True, False, True]


@pytest.mark.parametrize("solver", ["second_order", "adam"])
def test_a_fit_from_the_true_hand_alone_stays_there(hand: HandModel, solver: str) -> None:
    landmarks, parameters = seen(hand)
    seen_by_fit = observed(to_crops(landmarks).batch)
    objective = Objective(hand, Prior({}), NegativeLogLikelihood())
    light = hand.landmarks_only()
    descent = Descent(solver=solver, starts=0, steps=5, learning_rate=1e-4)
    found = fit(
        seen_by_fit,
        objective,
        descent=descent,
        further=lambda piece: estimated_start(piece, light),
    )
    prediction = found.prediction.detach()
    off = (prediction.landmarks_2d - seen_by_fit.landmarks_2d).norm(dim=-1)
    moved = prediction.parameters.joint_angles - parameters.joint_angles
    assert float(moved.abs().max()) < 2e-2
    assert float(off.mean()) < 0.3


def test_a_hand_of_another_shape_is_placed_where_the_landmarks_are(hand: HandModel) -> None:
    """A hand a tenth larger is a tenth farther away, whatever depth the estimate had."""
    landmarks, parameters = seen(hand)
    larger = hand.of_shape(torch.zeros(10)).with_arrays(
        template=1.1 * hand.template, joints_template=1.1 * hand.joints_template
    )
    # A copy of a copy of one shape is one, too.
    assert larger.one_shape
    mean = replace(parameters, shape=torch.zeros(3, 10))
    posed = hand.to_camera(mean)
    exact = Observation(
        project(posed.landmarks, CAMERA.expand(3, 3, 3)),
        landmarks.labelled,
        CAMERA.expand(3, 3, 3),
        estimate=HandEstimate(
            replace(mean, translation=2 * mean.translation), torch.zeros(3, 21, 2)
        ),
    )
    start = estimated_start(exact, larger)
    torch.testing.assert_close(
        start.translation[:, 0], 1.1 * parameters.translation, rtol=1e-3, atol=1e-4
    )
    assert_close(estimated_start(exact, hand).translation[:, 0], 2 * mean.translation)


def test_landmarks_without_an_estimate_are_refused(hand: HandModel) -> None:
    landmarks, _ = seen(hand)
    without = observed(to_crops(replace(landmarks, estimate=None)).batch)
    for function in (estimated_hands, estimated_start):
        with pytest.raises(ValueError, match="without a network's estimate; expected one per hand"):
            function(without, hand)
