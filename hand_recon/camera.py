"""Full-perspective camera model with scale, rotation and translation [s, R, t] (Sec. 3.1).

Without calibration, the crop is treated as the whole image of a camera with its principal point at the
centre and a focal length of 500 px on a crop of 224 px, as the authors do. With a known camera matrix, the
same raw numbers give the hand's position and size in the crop: the network's task stays the same, and the
3D hand is right for the true camera.
"""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from hand_recon import schema

REFERENCE_SIZE: Final = float(schema.REFERENCE_SIZE)
"""Side of the paper's crop, pixels; the data term and σ are measured in pixels of this crop."""

REFERENCE_FOCAL: Final = 500.0
"""Focal length on the reference crop, pixels (the authors' constants; decision 5)."""

LOG_SCALE_CENTRE: Final = 6.55
"""Log scale at which `bounded_log_scale` changes nothing: a hand of 18 cm spans half of the crop."""

LOG_SCALE_REACH: Final = 1.05
"""Largest deviation of the log scale from `LOG_SCALE_CENTRE`."""


def default_intrinsics(crop_size: int, like: Tensor) -> Float[Tensor, "3 3"]:
    """Camera matrix that is assumed for an uncalibrated crop, pixels of the crop."""
    focal = REFERENCE_FOCAL * crop_size / REFERENCE_SIZE
    centre = crop_size / 2
    # Made where it is used: a copy would wait for everything that a GPU has to do before it.
    f, c, zero, one = (like.new_full((), value) for value in (focal, centre, 0.0, 1.0))
    return torch.stack([f, zero, c, zero, f, c, zero, zero, one]).view(3, 3)


def project(
    points: Float[Tensor, "*batch point 3"], intrinsics: Float[Tensor, "*batch 3 3"]
) -> Float[Tensor, "*batch point 2"]:
    """Project points to pixels, with depths clamped to at least 1 cm.

    Args:
        points: Camera frame, metres. The clamp keeps gradients finite when a prediction lies behind the
            camera early in training.
        intrinsics: Camera matrix, pixels.
    """
    depth = points[..., 2:].clamp(min=0.01)
    on_plane = torch.cat([points[..., :2] / depth, torch.ones_like(depth)], dim=-1)
    return (on_plane @ intrinsics.mT)[..., :2]


def project_array(
    points: Float[np.ndarray, "*batch point 3"], intrinsics: Float[np.ndarray, "*camera 3 3"]
) -> Float[np.ndarray, "*batch point 2"]:
    """Project NumPy points to pixels, u = K x / z, without a clamp on depth.

    Args:
        points: Camera frame, metres. A depth of zero gives infinity or NaN.
        intrinsics: Camera matrix, pixels: one for all points or one for each batch entry.
    """
    on_plane = points / points[..., 2:]
    return np.asarray((on_plane @ intrinsics.swapaxes(-2, -1))[..., :2])


def raw_to_translation(raw: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Convert the network's (log s, t_x, t_y) to a translation in the uncalibrated camera, metres (Sec. 3.1).

    T = (t_x, t_y, f / s), where s = exp(raw scale) is in pixels of the reference crop per metre. A hand that
    fills two thirds of the crop has a raw scale near 6.7.
    """
    depth = REFERENCE_FOCAL * torch.exp(-raw[..., :1])
    return torch.cat([raw[..., 1:], depth], dim=-1)


def bounded_log_scale(raw: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Bound the log scale to 5.5–7.6: a hand of 18 cm spans between a fifth of the crop and 1.6 crops.

    Without a bound, training shrinks every hand to a dot while orientations are still wrong: a dot has the
    smallest squared error, and at that distance the gradient is too small to recover (decision 22).
    """
    return LOG_SCALE_CENTRE + LOG_SCALE_REACH * torch.tanh(
        (raw - LOG_SCALE_CENTRE) / LOG_SCALE_REACH
    )


def move_points(
    points: Float[Tensor, "*batch point 2"], matrices: Float[Tensor, "*batch 3 3"]
) -> Float[Tensor, "*batch point 2"]:
    """Move pixels of an image or crop to those of another; NaN stays NaN.

    Args:
        points: Pixels.
        matrices: Affine matrices from old pixels to new ones.
    """
    return points @ matrices[..., :2, :2].mT + matrices[..., None, :2, 2]


def move_pixels(
    images: Float[Tensor, "batch channel size size"], matrices: Float[Tensor, "batch 3 3"]
) -> Float[Tensor, "batch channel size size"]:
    """Resample square images bilinearly, black outside, so that their points move as by `move_points`.

    Args:
        images: Square images.
        matrices: Affine matrices from old to new pixels; pixel i covers [i, i + 1) as in
            `hand_recon.data.crop`.
    """
    size = images.shape[-1]
    to_pixels = matrices.new_tensor([[size / 2, 0, size / 2], [0, size / 2, size / 2], [0, 0, 1]])
    # The grid holds the source of each new pixel, in units in which the image spans [−1, 1].
    source = (torch.linalg.inv(matrices @ to_pixels) @ to_pixels)[:, :2].to(images)
    centres = (torch.arange(size, device=images.device, dtype=images.dtype) + 0.5) * 2 / size - 1
    # An outer sum: on a CPU fifty times faster than `affine_grid`, which multiplies matrices.
    rows = source[..., 1:2] * centres + source[..., 2:]
    grid = source[..., 0, None, None] * centres + rows[..., None]
    return functional.grid_sample(images, grid.permute(0, 2, 3, 1), align_corners=False)


def to_true_camera(
    rotation: Float[Tensor, "*batch 3 3"],
    translation: Float[Tensor, "*batch 3"],
    intrinsics: Float[Tensor, "*batch 3 3"],
    crop_size: int,
) -> tuple[Float[Tensor, "*batch 3 3"], Float[Tensor, "*batch 3"]]:
    """Convert rotation and translation from the uncalibrated camera to one with a known matrix.

    The hand keeps its position and size in the crop. Its depth follows from the true focal length, and it
    rotates with the viewing ray, so that an off-centre crop shows the same side of it.

    Args:
        rotation: Rotation from the hand's frame to the uncalibrated camera's.
        translation: Position in the uncalibrated camera's frame, metres.
        intrinsics: Camera matrix of the crop, pixels of the crop.
        crop_size: Side of the crop, pixels.
    """
    assumed = default_intrinsics(crop_size, translation).expand_as(intrinsics)
    pixel = project(translation[..., None, :], assumed)[..., 0, :]
    homogeneous = torch.cat([pixel, torch.ones_like(pixel[..., :1])], dim=-1)
    ray = torch.linalg.solve(intrinsics, homogeneous[..., None])[..., 0]
    assumed_ray = torch.linalg.solve(assumed, homogeneous[..., None])[..., 0]
    # The determinant gives the focal length of skewed and rotated crops too.
    focal = torch.linalg.det(intrinsics[..., :2, :2]).abs().sqrt()
    depth = translation[..., 2] * focal / assumed[..., 0, 0]
    between_rays = rotation_between(assumed_ray, ray)
    return between_rays @ rotation, ray * depth[..., None]


def rotation_between(
    source: Float[Tensor, "*batch 3"], target: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3 3"]:
    """Smallest rotation that takes one direction to another less than 180° away (Rodrigues)."""
    source = torch.nn.functional.normalize(source, dim=-1)
    target = torch.nn.functional.normalize(target, dim=-1)
    axis = torch.linalg.cross(source, target)
    cosine = (source * target).sum(dim=-1)[..., None, None]
    zero = torch.zeros_like(axis[..., 0])
    skew = torch.stack(
        [zero, -axis[..., 2], axis[..., 1], axis[..., 2], zero, -axis[..., 0],
         -axis[..., 1], axis[..., 0], zero], dim=-1,
    ).unflatten(-1, (3, 3))  # fmt: skip
    eye = torch.eye(3, dtype=source.dtype, device=source.device)
    return eye + skew + skew @ skew / (1 + cosine)


def six_d_to_rotation(six: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3 3"]:
    """Convert six numbers, a rotation's first two columns, by Gram–Schmidt (Zhou et al., CVPR 2019).

    The authors' code has Euler angles for the root, which lock at ±90° (decision 3).
    """
    first = torch.nn.functional.normalize(six[..., :3], dim=-1)
    rest = six[..., 3:] - (first * six[..., 3:]).sum(dim=-1, keepdim=True) * first
    second = torch.nn.functional.normalize(rest, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)
