"""Several looks at a crop, turned, which together find landmarks better than one (decision 75)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import move_pixels, move_points

AS_IT_IS: Final = 0.95
"""Factor on the spread of the look at the crop as it is: photographs mostly show hands upright."""

Images = Float[Tensor, "batch 3 size size"]


@dataclass(frozen=True)
class Look:
    """Findings of a network in crops, by looking at them once or several times."""

    landmarks: Float[Tensor, "batch landmark=21 2"]
    """Landmarks, pixels of the crop."""
    spread: Float[Tensor, "batch landmark=21"]
    """Standard deviation of the landmarks' maps, in sides of the crop."""
    summary: Float[Tensor, "batch feature"]
    """Features of the crop as a whole."""


def look_around(look: Callable[[Images], Look], images: Images, turns: Sequence[float]) -> Look:
    """Look at crops turned by the four right angles, and at the surest of these again, turned by less.

    A network that has seen hands turned by up to 45° meets every hand in one of the four. Its
    errors in crops turned by different angles differ, so that their mean is better.

    Args:
        look: A single look.
        images: Crops.
        turns: Angles of the further looks, from x towards y, degrees.

    Returns:
        The mean of the landmarks of the surest look and of the further ones, in pixels of the crop as it
        is; spread and summary of the surest look.
    """
    size, device = images.shape[-1], images.device
    # Exact, where resampling would blur.
    looks = _together(look, [torch.rot90(images, -quarter, (-2, -1)) for quarter in range(4)])
    spread = torch.stack([one.spread.mean(dim=-1) for one in looks])
    spread[0] *= AS_IT_IS
    surest, rows = spread.argmin(dim=0), torch.arange(images.shape[0], device=device)

    def chosen(values: Sequence[Tensor]) -> Tensor:
        return torch.stack(list(values))[surest, rows]

    best = Look(
        chosen([one.landmarks for one in looks]),
        chosen([one.spread for one in looks]),
        chosen([one.summary for one in looks]),
    )
    # Mixed precision is for the network: bfloat16 rounds 200 pixels to whole ones.
    with torch.autocast(device.type, enabled=False):
        quarters = torch.stack([_turn(90.0 * quarter, size) for quarter in range(4)]).to(device)
        of_best = quarters[surest]
        matrices = [_turn(degrees, size).to(device) @ of_best for degrees in turns]
        crops = [move_pixels(images, matrix) for matrix in matrices]
    seen = [best, *(_together(look, crops) if crops else [])]
    with torch.autocast(device.type, enabled=False):
        found = [
            move_points(one.landmarks, torch.linalg.inv(matrix))
            for one, matrix in zip(seen, [of_best, *matrices], strict=True)
        ]
    return replace(best, landmarks=torch.stack(found).mean(dim=0))


def _together(look: Callable[[Images], Look], crops: Sequence[Images]) -> list[Look]:
    """Look at several crops of each hand in one batch, which is faster for a few hands."""
    seen, each = look(torch.cat(list(crops))), (len(crops), crops[0].shape[0])
    parts = zip(
        *(
            values.unflatten(0, each).unbind()
            for values in (seen.landmarks, seen.spread, seen.summary)
        ),
        strict=True,
    )
    return [Look(*part) for part in parts]


def _turn(degrees: float, size: int) -> Float[Tensor, "3 3"]:
    """Rotation about the middle of a crop, from x towards y; matrix from old to new pixels."""
    angle = math.radians(degrees)
    matrix = torch.eye(3)
    matrix[0, 0] = matrix[1, 1] = math.cos(angle)
    matrix[0, 1], matrix[1, 0] = -math.sin(angle), math.sin(angle)
    matrix[:2, 2] = size / 2 - matrix[:2, :2].sum(dim=-1) * size / 2
    return matrix
