"""Conversions between axis angles, MANO's form of rotations, and rotation matrices."""

import torch
from jaxtyping import Float
from torch import Tensor

SMALL = 1e-8
"""Squared angle below which the Taylor series is exact to double precision, radians²."""


def axis_angle_to_rotation(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Convert axis angles to rotation matrices by Rodrigues' formula, with a finite gradient at zero.

    Args:
        axis_angle: Axis times angle, radians.
    """
    squared = axis_angle.square().sum(dim=-1, keepdim=True)[..., None]
    small = squared < SMALL
    angle = torch.where(small, torch.ones_like(squared), squared).sqrt()
    sine = torch.where(small, 1 - squared / 6, angle.sin() / angle)
    versine = torch.where(small, 0.5 - squared / 24, 2 * ((angle / 2).sin() / angle).square())
    x, y, z = axis_angle.unbind(dim=-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))
    eye = torch.eye(3, dtype=axis_angle.dtype, device=axis_angle.device)
    return eye + sine * cross + versine * (cross @ cross)


def rotation_to_axis_angle(rotation: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3"]:
    """Convert rotation matrices to axis angles of at most 180°, the inverse of `axis_angle_to_rotation`.

    The conversion goes through the quaternion by its largest component, so it is exact near 0° and 180°.
    """
    (a, b, c), (d, e, f), (g, h, i) = (row.unbind(dim=-1) for row in rotation.unbind(dim=-2))
    products = torch.stack([
        torch.stack([1 + a + e + i, h - f, c - g, d - b], dim=-1),
        torch.stack([h - f, 1 + a - e - i, d + b, c + g], dim=-1),
        torch.stack([c - g, d + b, 1 - a + e - i, h + f], dim=-1),
        torch.stack([d - b, c + g, h + f, 1 - a - e + i], dim=-1),
    ], dim=-2)  # fmt: skip
    # Each row is the quaternion (w, x, y, z) times four times one of its components.
    largest = products.diagonal(dim1=-2, dim2=-1).argmax(dim=-1)[..., None, None]
    row = products.take_along_dim(largest, dim=-2).squeeze(-2)
    quaternion = torch.nn.functional.normalize(row, dim=-1)
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    length = quaternion[..., 1:].norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(length, quaternion[..., :1])
    factor = torch.where(
        length < SMALL, 2 * torch.ones_like(length), angle / length.clamp(min=SMALL)
    )
    return factor * quaternion[..., 1:]


def mirror_axis_angle(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Mirror rotations at the plane x = 0, which exchanges left and right hands: (x, −y, −z).

    Coefficients of MANO's pose components cannot be mirrored like this: convert them to axis angles first.
    """
    return axis_angle * torch.tensor(
        [1.0, -1.0, -1.0], dtype=axis_angle.dtype, device=axis_angle.device
    )
