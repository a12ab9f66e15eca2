"""Hands from a trained lifter: its prediction in one network pass, as the result or as a start of a fit."""

import torch

from hand_recon.camera import project, to_true_camera
from hand_recon.data.augment import move
from hand_recon.data.upright import upright_motion
from hand_recon.fitting.observation import Observation, confidence_of_sigma
from hand_recon.fitting.start import Start
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.schema import REFERENCE_SIZE, HandBatch, HandParameters, HandPrediction


@torch.no_grad()
def lift(regressor: Regressor, observation: Observation) -> HandPrediction:
    """Predict hands with a lifter, in the camera and the crops of the observation, with the lifter's σ.

    Args:
        regressor: Lifter, a regressor with an encoder of landmarks, in evaluation mode.
        observation: Hands in any roll; they are rotated fingers up, as in the lifter's training.
    """
    count = len(observation)
    batch = HandBatch(
        image=torch.empty(count, 3, 0, 0),
        landmarks_2d=observation.landmarks_2d,
        labelled=observation.labelled,
        confidence=None if observation.sigma is None else confidence_of_sigma(observation.sigma),
        index=torch.arange(count),
        source=("",) * count,
    )
    motion = upright_motion(batch.landmarks_2d, batch.labelled, REFERENCE_SIZE)
    prediction: HandPrediction = regressor(move(batch, motion))
    found = prediction.parameters
    # The observation's camera after the roll about its axis that makes the hand upright.
    back = motion.camera.mT
    upright = motion.pixels @ observation.intrinsics @ back
    rotation, translation = to_true_camera(
        found.root_rotation, found.translation, upright, REFERENCE_SIZE
    )
    parameters = HandParameters(
        found.joint_angles, found.shape, back @ rotation, (back @ translation[..., None])[..., 0]
    )
    hand = regressor.hand.to_camera(parameters)
    # The roll mixes the variances of the two coordinates; their correlation is ignored.
    squares = back[:, None, :2, :2].square() @ torch.exp(2 * prediction.log_sigma)[..., None]
    return HandPrediction(
        parameters=parameters,
        vertices=hand.vertices,
        joints=hand.joints,
        landmarks_3d=hand.landmarks,
        landmarks_2d=project(hand.landmarks, observation.intrinsics),
        log_sigma=squares[..., 0].log() / 2 - motion.scale.log()[:, None, None],
        intrinsics=observation.intrinsics,
    )


def lifted_start(regressor: Regressor, observation: Observation) -> Start:
    """Predict one start per hand with a lifter; arguments as for `lift`."""
    found = lift(regressor, observation).parameters
    return Start(
        found.joint_angles[:, None],
        found.root_rotation[:, None],
        found.translation[:, None],
        found.shape[:, None],
    )
