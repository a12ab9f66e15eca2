"""Normalization of landmarks: centred, scaled to one size and rotated so that the fingers point up.

Rotation and scale of the image are removed before lifting, so that the lifter need not learn them. The
transform can be inverted, so no information is lost.
"""

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.schema import CropMotion

FILL = 0.7
"""Side of the landmarks' bounding square in the new crop, as a share of the crop's."""

# Slices, since a list of indices would be copied to a GPU, and waited for, at each use.
_FINGERS = slice(LANDMARKS.index("index MCP"), len(LANDMARKS))


def _wrist(values: Tensor) -> Tensor:
    """The wrist's row of an array with a row for each landmark."""
    start = LANDMARKS.index("wrist")
    return values[:, start : start + 1]


def _knuckles(values: Tensor) -> Tensor:
    """The rows of the four fingers' MCPs."""
    return values[:, _FINGERS].unflatten(1, (4, 4))[:, :, 0]


def _beyond(values: Tensor) -> Tensor:
    """The rows of the landmarks beyond these, finger by finger."""
    return values[:, _FINGERS].unflatten(1, (4, 4))[:, :, 1:].flatten(1, 2)


def upright_motion(
    landmarks_2d: Float[Tensor, "batch landmark=21 2"],
    labelled: Bool[Tensor, "batch landmark=21"],
    crop_size: int,
) -> CropMotion:
    """Transform of each crop that centres its landmarks, scales them to one size and points the fingers up.

    The fingers' direction is from the wrist to the MCPs; without a wrist, from the MCPs to the landmarks
    beyond them; without these, the crop is not rotated.

    Args:
        landmarks_2d: Pixels of the crop; values of unlabelled landmarks are ignored.
        labelled: True for labelled landmarks.
        crop_size: Side of the crop, pixels; the new one is as large.
    """
    points = landmarks_2d.masked_fill(~labelled[..., None], 0.0)
    roll = _camera_roll(_direction_up(points, labelled))
    rotated = points @ roll[:, :2, :2].mT
    missing = ~labelled[..., None]
    high = rotated.masked_fill(missing, -torch.inf).amax(dim=1)
    low = rotated.masked_fill(missing, torch.inf).amin(dim=1)
    none = ~labelled.any(dim=1)[:, None]
    middle = ((high + low) / 2).masked_fill(none, crop_size / 2)
    # A single landmark has no extent; a minimum of one pixel keeps the scale finite.
    extent = (high - low).amax(dim=1).masked_fill(none[:, 0], FILL * crop_size).clamp(min=1.0)
    scale = FILL * crop_size / extent
    pixels = torch.eye(3, dtype=points.dtype, device=points.device).repeat(points.shape[0], 1, 1)
    pixels[:, :2, :2] = scale[:, None, None] * roll[:, :2, :2]
    pixels[:, :2, 2] = crop_size / 2 - scale[:, None] * middle
    return CropMotion(pixels=pixels, camera=roll, scale=scale)


def _direction_up(points: Tensor, labelled: Tensor) -> Float[Tensor, "batch 2"]:
    """Unit direction of the fingers in the image; upwards (0, −1) where it is unknown."""
    zero = torch.zeros_like(points[:, 0, :1])
    up = torch.cat([zero, zero - 1], dim=-1)
    for start, end in ((_knuckles, _beyond), (_wrist, _knuckles)):
        known = start(labelled).any(dim=1) & end(labelled).any(dim=1)
        ahead = _mean(points, labelled, end) - _mean(points, labelled, start)
        known = known & (ahead.norm(dim=-1) > 0)
        up = torch.where(known[:, None], ahead, up)
    return torch.nn.functional.normalize(up, dim=-1)


def _mean(points: Tensor, labelled: Tensor, rows: Callable[[Tensor], Tensor]) -> Tensor:
    count = rows(labelled).sum(dim=1, keepdim=True).clamp(min=1)
    return rows(points).sum(dim=1) / count


def _camera_roll(up: Float[Tensor, "batch 2"]) -> Float[Tensor, "batch 3 3"]:
    """The rotation about the optical axis that takes a direction of the image to (0, −1)."""
    sine, cosine = up[:, 0], -up[:, 1]
    roll = torch.zeros(up.shape[0], 3, 3, dtype=up.dtype, device=up.device)
    roll[:, 0, 0], roll[:, 0, 1] = cosine, sine
    roll[:, 1, 0], roll[:, 1, 1] = -sine, cosine
    roll[:, 2, 2] = 1
    return roll
