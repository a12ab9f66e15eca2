"""Hands from a trained lifter: its prediction in one network pass, as the result or as a start of a fit."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.data.augment import move
from hand_recon.fitting.observation import Observation, confidence_of_sigma
from hand_recon.fitting.start import SHALLOWEST, Start
from hand_recon.hand.model import HandModel
from hand_recon.hand.upright import upright_motion
from hand_recon.regressor.error_feedback import Regressor, in_camera
from hand_recon.schema import (
    REFERENCE_SIZE,
    CropMotion,
    HandBatch,
    HandParameters,
    HandPrediction,
)


@torch.no_grad()
def lift(
    regressor: Regressor, observation: Observation, hand: HandModel | None = None
) -> HandPrediction:
    """Predict hands with a lifter, in the camera and the crops of the observation, with the lifter's σ.

    Args:
        regressor: Lifter, a regressor with an encoder of landmarks, in evaluation mode.
        observation: Hands in any roll; they are rotated fingers up, as in the lifter's training.
        hand: The lifter's hand model with another landmark set, that of the observation; none for its own.
    """
    return lift_batch(regressor, _batch_of(observation), observation.intrinsics, hand)


def lift_batch(
    regressor: Regressor,
    batch: HandBatch,
    intrinsics: Float[Tensor, "hand 3 3"],
    hand: HandModel | None = None,
) -> HandPrediction:
    """Predict the hands of a batch of landmarks without images; see `lift`.

    Args:
        regressor: Lifter, in evaluation mode.
        batch: Landmarks in any roll and at any scale.
        intrinsics: Camera matrix of each hand, pixels of its landmarks.
        hand: The lifter's hand model with another landmark set; none for its own.
    """
    motion = upright_motion(batch.landmarks_2d, batch.labelled, REFERENCE_SIZE)
    prediction: HandPrediction = regressor(move(batch, motion))
    parameters = _in_true_camera(prediction.parameters, motion, intrinsics)
    posed = (hand or regressor.hand).to_camera(parameters)
    # The roll mixes the variances of the two coordinates; their correlation is ignored.
    back = motion.camera.mT
    squares = back[:, None, :2, :2].square() @ torch.exp(2 * prediction.log_sigma)[..., None]
    return HandPrediction(
        parameters=parameters,
        vertices=posed.vertices,
        joints=posed.joints,
        landmarks_3d=posed.landmarks,
        landmarks_2d=project(posed.landmarks, intrinsics),
        log_sigma=squares[..., 0].log() / 2 - motion.scale.log()[:, None, None],
        intrinsics=intrinsics,
    )


@torch.no_grad()
def lifted_start(regressor: Regressor, observation: Observation) -> Start:
    """Predict one start per hand with a lifter; arguments as for `lift`.

    No surface is posed, which would take most of the time.
    """
    batch, motion = _upright(observation)
    return Start.one_each(_in_true_camera(regressor.place(batch), motion, observation.intrinsics))


@torch.no_grad()
def carried_start(
    hand: HandModel, regressor: Regressor, observation: Observation, *, with_shape: bool
) -> Start:
    """Predict one start per hand of another landmark set, or of another hand model, than the lifter's.

    Joint angles are anatomical and the rotation is that of the palm, so that they carry over. The position
    follows from the landmarks by least squares.

    Args:
        hand: Hand model that is fitted, without its surface (`landmarks_only`).
        regressor: Lifter, as for `lift`.
        observation: Landmarks in the landmark set of `hand`.
        with_shape: True if coefficients of shape mean the same in both; else the start has the mean shape.
    """
    found = lifted_start(regressor, observation)
    angles, rotation = found.joint_angles[:, 0], found.root_rotation[:, 0]
    shape = found.shape[:, 0] if with_shape else torch.zeros_like(found.shape[:, 0])
    points = hand(angles, shape).landmarks @ rotation.mT
    translation = position_of(
        points, observation.landmarks_2d, observation.labelled, observation.intrinsics
    )
    return Start.one_each(HandParameters(angles, shape, rotation, translation))


def position_of(
    points: Float[Tensor, "hand landmark=21 3"],
    landmarks_2d: Float[Tensor, "hand landmark=21 2"],
    labelled: Bool[Tensor, "hand landmark=21"],
    intrinsics: Float[Tensor, "hand 3 3"],
) -> Float[Tensor, "hand 3"]:
    """Translation that brings points nearest to the rays of landmarks, in metres.

    With the ray (a, b, 1) of a landmark, x + t_x = a (z + t_z) and y + t_y = b (z + t_z) are linear in the
    translation t; all landmarks are solved by least squares.

    Args:
        points: Points of each hand, rotated as in the camera's frame, metres.
        landmarks_2d: Landmarks, pixels; ignored where not labelled.
        labelled: Mask of the given landmarks.
        intrinsics: Camera matrices, same pixels.
    """
    seen = torch.cat([landmarks_2d, torch.ones_like(landmarks_2d[..., :1])], dim=-1)
    seen = seen.masked_fill(~labelled[..., None], 0.0)
    rays = torch.linalg.solve(intrinsics, seen.mT).mT[..., :2]
    weight = labelled[..., None].to(points)
    # One row per coordinate of a landmark: the factors of t_x, t_y, t_z, and the right side.
    across = torch.eye(2, dtype=points.dtype, device=points.device).expand(*rays.shape, 2)
    design = torch.cat([across, -rays[..., None]], dim=-1) * weight[..., None]
    right = (rays * points[..., 2:] - points[..., :2]) * weight
    matrix, side = design.flatten(1, 2), right.flatten(1)[..., None]
    # Regularization, because a single landmark leaves the depth undetermined.
    damping = 1e-9 * torch.eye(3, dtype=points.dtype, device=points.device)
    found = torch.linalg.solve(matrix.mT @ matrix + damping, matrix.mT @ side)[..., 0]
    return torch.cat([found[:, :2], found[:, 2:].clamp(min=SHALLOWEST)], dim=-1)


def _upright(observation: Observation) -> tuple[HandBatch, CropMotion]:
    """The observation as a lifter sees it, fingers up, and the motion that made it so."""
    batch = _batch_of(observation)
    motion = upright_motion(batch.landmarks_2d, batch.labelled, REFERENCE_SIZE)
    return move(batch, motion), motion


def _batch_of(observation: Observation) -> HandBatch:
    """The observation's landmarks and confidences as a batch without images."""
    count = len(observation)
    return HandBatch(
        image=torch.empty(count, 3, 0, 0),
        landmarks_2d=observation.landmarks_2d,
        labelled=observation.labelled,
        confidence=None if observation.sigma is None else confidence_of_sigma(observation.sigma),
        index=torch.arange(count),
        source=("",) * count,
    )


def _in_true_camera(
    found: HandParameters, motion: CropMotion, intrinsics: Float[Tensor, "hand 3 3"]
) -> HandParameters:
    """Parameters of upright crops in the camera of the observation."""
    return in_camera(found, motion, intrinsics, REFERENCE_SIZE)
