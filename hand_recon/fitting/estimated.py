"""Hands from a network's estimate beside their landmarks: as the result or as a start of a fit."""

from dataclasses import replace

import torch

from hand_recon.camera import project
from hand_recon.fitting.lift import position_of
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import Start
from hand_recon.hand.model import HandModel
from hand_recon.schema import HandEstimate, HandPrediction


@torch.no_grad()
def estimated_hands(observation: Observation, hand: HandModel) -> HandPrediction:
    """Pose the estimates of an observation in its crops, with the network's σ.

    Args:
        observation: Hands with an estimate.
        hand: Hand model of the estimate, with any landmark set.

    Raises:
        ValueError: The observation has no estimate.
    """
    found = _estimate(observation)
    posed = hand.to_camera(found.parameters)
    return HandPrediction(
        parameters=found.parameters,
        vertices=posed.vertices,
        joints=posed.joints,
        landmarks_3d=posed.landmarks,
        landmarks_2d=project(posed.landmarks, observation.intrinsics),
        log_sigma=found.log_sigma,
        intrinsics=observation.intrinsics,
    )


@torch.no_grad()
def estimated_start(observation: Observation, hand: HandModel) -> Start:
    """One start per hand from the estimates of an observation.

    Of a hand model of one shape, which is another one than that of the estimate, the position follows from
    the landmarks.

    Args:
        observation: Hands with an estimate.
        hand: Hand model that is fitted: that of the estimate, or a copy of it that has one shape.

    Raises:
        ValueError: The observation has no estimate.
    """
    found = _estimate(observation).parameters
    translation = found.translation
    if hand.one_shape:
        shape = torch.zeros_like(found.shape)
        points = hand(found.joint_angles, shape).landmarks @ found.root_rotation.mT
        translation = position_of(
            points, observation.landmarks_2d, observation.labelled, observation.intrinsics
        )
    return Start.one_each(replace(found, translation=translation))


def _estimate(observation: Observation) -> HandEstimate:
    if observation.estimate is None:
        raise ValueError(
            "Found landmarks without a network's estimate; expected one per hand, as `predict` with ckpt=… "
            "makes them. Leave ckpt out, or give photographs."
        )
    return observation.estimate
