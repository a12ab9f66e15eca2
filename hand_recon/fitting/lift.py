"""A trained lifter's answer as a start: one network pass in place of a search."""

import torch

from hand_recon.camera import to_true_camera
from hand_recon.data.augment import move
from hand_recon.data.upright import upright_motion
from hand_recon.fitting.observation import Observation, confidence_of_sigma
from hand_recon.fitting.start import Start
from hand_recon.reconstructor import Reconstructor
from hand_recon.schema import REFERENCE_SIZE, HandBatch, HandPrediction


@torch.no_grad()
def lifted_start(reconstructor: Reconstructor, observation: Observation) -> Start:
    """The lifter's answer in the camera of the observation: one start per hand.

    Args:
        reconstructor: With an encoder of landmarks, in evaluation mode.
        observation: Hands in any roll; the lifter sees them as its training's, fingers up.
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
    prediction: HandPrediction = reconstructor(move(batch, motion))
    found = prediction.parameters
    # In the upright crop, the observation's camera has this matrix, after a roll about its axis.
    roll = motion.camera
    upright = motion.pixels @ observation.intrinsics @ roll.mT
    rotation, translation = to_true_camera(
        found.root_rotation, found.translation, upright, REFERENCE_SIZE
    )
    back = roll.mT
    return Start(
        found.joint_angles[:, None],
        (back @ rotation)[:, None],
        (back @ translation[..., None])[..., 0][:, None],
    )
