"""Conversion of the MANO labels of FreiHAND, DexYCB and HO3D to `ManoParameters`.

The datasets differ in whether the pose includes the mean pose, in the pose's representation, in how the
hand's position is stored and in the camera's axes. Sources: lmb-freiburg/freihand, NVlabs/dex-ycb-toolkit,
shreyashampali/ho3d.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.hand.axis_angle import axis_angle_to_rotation, rotation_to_axis_angle
from hand_recon.hand.mano.layer import ManoLayer, ManoParameters
from hand_recon.hand.skeleton import ROOT_LANDMARK


def freihand_parameters(
    layer: ManoLayer,
    label: Float[Tensor, "*batch number=61"],
    intrinsics: Float[Tensor, "*batch 3 3"],
) -> ManoParameters:
    """Convert entries of FreiHAND's `training_mano.json`.

    Args:
        layer: Right hand with the landmark set `mano`.
        label: Global rotation 3, axis angles relative to the mean pose 45, shape 10, pixel of the
            middle MCP's landmark 2, scale 1.
        intrinsics: Camera matrix of the same image, pixels.
    """
    rotation, residual, shape, pixel, scale = label.split((3, 45, 10, 2, 1), dim=-1)
    pose = layer.from_residual(residual)
    root = freihand_root(pixel, scale[..., 0], intrinsics)
    untranslated = layer(rotation, pose, shape, torch.zeros_like(root))
    translation = root - untranslated.landmarks[..., ROOT_LANDMARK, :]
    return ManoParameters(rotation, pose, shape, translation)


def freihand_root(
    pixel: Float[Tensor, "*batch 2"],
    scale: Float[Tensor, "*batch"],
    intrinsics: Float[Tensor, "*batch 3 3"],
) -> Float[Tensor, "*batch 3"]:
    """Middle MCP of FreiHAND's labels, metres: (u − cx, v − cy, f) / scale, with the mean focal length f.

    Args:
        pixel: Pixel of the middle MCP's landmark.
        scale: Pixels per metre at its depth.
        intrinsics: Camera matrix, pixels.
    """
    focal = (intrinsics[..., 0, 0] + intrinsics[..., 1, 1]) / 2
    ray = torch.cat([pixel - intrinsics[..., :2, 2], focal[..., None]], dim=-1)
    return ray / scale[..., None]


def dexycb_parameters(
    layer: ManoLayer,
    label: Float[Tensor, "*batch number=51"],
    shape: Float[Tensor, "*batch direction=10"],
) -> ManoParameters:
    """Convert `pose_m` of DexYCB labels and `betas` of the sequence's calibration.

    Args:
        layer: Hand of the sequence's side, with the landmark set `dexycb` and `fix_left_shape=False`.
        label: Global rotation 3, coefficients of the pose components about the mean pose 45, translation 3.
        shape: Coefficients of the shape directions, standard deviations.
    """
    rotation, coefficients, translation = label.split((3, 45, 3), dim=-1)
    return ManoParameters(rotation, layer.from_pca(coefficients), shape, translation)


def ho3d_parameters(
    layer: ManoLayer,
    pose: Float[Tensor, "*batch number=48"],
    shape: Float[Tensor, "*batch direction=10"],
    translation: Float[Tensor, "*batch 3"],
) -> ManoParameters:
    """Convert `handPose`, `handBeta` and `handTrans` of HO3D, from OpenGL's camera axes to OpenCV's.

    Args:
        layer: Right hand with the landmark set `ho3d`.
        pose: Global rotation 3, axis angles from the rest pose 45, mean pose included.
        shape: Coefficients of the shape directions, standard deviations.
        translation: Metres, in OpenGL's axes: y up, looking along −z.
    """
    rotation, angles = pose.split((3, 45), dim=-1)
    rotation, translation = from_opengl(rotation, translation, layer.wrist(shape))
    return ManoParameters(rotation, angles, shape, translation)


def from_opengl(
    global_rotation: Float[Tensor, "*batch 3"],
    translation: Float[Tensor, "*batch 3"],
    wrist: Float[Tensor, "*batch 3"],
) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3"]]:
    """Convert MANO's global rotation and translation between OpenGL's and OpenCV's axes, in either direction.

    All points are multiplied by F = diag(1, −1, −1). MANO rotates about its wrist J0 and not about its
    origin, so R' = F R and t' = F (J0 + t) − J0.
    """
    flip = torch.tensor([1.0, -1.0, -1.0], dtype=translation.dtype, device=translation.device)
    flipped = flip[:, None] * axis_angle_to_rotation(global_rotation)
    return rotation_to_axis_angle(flipped), flip * (wrist + translation) - wrist
