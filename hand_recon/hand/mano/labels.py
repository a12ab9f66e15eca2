"""What the MANO labels of FreiHAND, DexYCB and HO3D mean: each dataset's own rules, in one place.

They differ in whether the mean pose is in the pose, in how the pose is written, in what places the hand
and in the camera's axes. Sources: lmb-freiburg/freihand, NVlabs/dex-ycb-toolkit, shreyashampali/ho3d.
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
    """An entry of FreiHAND's `training_mano.json`.

    Args:
        layer: The right hand with the landmark set `mano`.
        label: Global rotation 3, axis angles relative to the mean pose 45, shape 10, pixel of the
            middle MCP's landmark 2, scale 1.
        intrinsics: Camera matrix of the same image, pixels.
    """
    rotation, residual, shape, pixel, scale = label.split((3, 45, 10, 2, 1), dim=-1)
    pose = layer.from_residual(residual)
    root = freihand_root(pixel, scale[..., 0], intrinsics)
    unplaced = layer(rotation, pose, shape, torch.zeros_like(root))
    return ManoParameters(rotation, pose, shape, root - unplaced.landmarks[..., ROOT_LANDMARK, :])


def freihand_root(
    pixel: Float[Tensor, "*batch 2"],
    scale: Float[Tensor, "*batch"],
    intrinsics: Float[Tensor, "*batch 3 3"],
) -> Float[Tensor, "*batch 3"]:
    """Where FreiHAND puts the middle MCP: (u − cx, v − cy, f) / scale, with one focal length for both axes.

    Args:
        pixel: Of the middle MCP's landmark.
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
    """The `pose_m` of a DexYCB label and the `betas` of its sequence's calibration.

    Args:
        layer: Of the sequence's side, with the landmark set `dexycb`, loaded with `fix_left_shape=False`.
        label: Global rotation 3, coefficients of the pose components about the mean 45, translation 3.
        shape: Standard deviations.
    """
    rotation, coefficients, translation = label.split((3, 45, 3), dim=-1)
    return ManoParameters(rotation, layer.from_pca(coefficients), shape, translation)


def ho3d_parameters(
    layer: ManoLayer,
    pose: Float[Tensor, "*batch number=48"],
    shape: Float[Tensor, "*batch direction=10"],
    translation: Float[Tensor, "*batch 3"],
) -> ManoParameters:
    """The `handPose`, `handBeta` and `handTrans` of HO3D, turned into this project's camera axes.

    Args:
        layer: The right hand, for the landmark set `ho3d`.
        pose: Global rotation 3, absolute axis angles 45; the mean pose is in them.
        shape: Standard deviations.
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
    """Global rotation and translation of the hand that stands at F = diag(1, −1, −1) times its points.

    R' = F R and t' = F (J0 + t) − J0, because MANO turns about its wrist J0 and not about its origin. The
    same takes OpenCV's axes back to OpenGL's.
    """
    flip = torch.tensor([1.0, -1.0, -1.0], dtype=translation.dtype, device=translation.device)
    turned = flip[:, None] * axis_angle_to_rotation(global_rotation)
    return rotation_to_axis_angle(turned), flip * (wrist + translation) - wrist
