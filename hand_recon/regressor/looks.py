"""Several looks at a crop, turned, which together find landmarks better than one (decision 75)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import move_pixels, move_points

UPRIGHT: Final = 0.95
"""Factor on the spread of the look at the crop as it is: photographs mostly show hands upright."""

Images = Float[Tensor, "batch 3 size size"]


@dataclass(frozen=True)
class Look:
    """What a network finds in crops by looking at them once, or what several looks amount to."""

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
    size = images.shape[-1]
    right_angles = [quarter * torch.pi / 2 for quarter in range(4)]
    matrices = torch.stack([_turn(images.new_tensor(angle), size) for angle in right_angles])
    # Exact, where resampling would blur.
    looks = _together(look, [torch.rot90(images, -quarter, (-2, -1)) for quarter in range(4)])
    spread = torch.stack([one.spread.mean(dim=-1) for one in looks])
    spread[0] *= UPRIGHT
    surest, rows = spread.argmin(dim=0), torch.arange(len(images), device=images.device)

    def chosen(values: Sequence[Tensor]) -> Tensor:
        return torch.stack(list(values))[surest, rows]

    upright = matrices[surest]
    found = [_back(chosen([one.landmarks for one in looks]), upright)]
    if turns:
        further = [_turn(images.new_tensor(degrees).deg2rad(), size) @ upright for degrees in turns]
        turned = _together(look, [move_pixels(images, matrix) for matrix in further])
        found += [_back(one.landmarks, matrix) for one, matrix in zip(turned, further, strict=True)]
    return Look(
        landmarks=torch.stack(found).mean(dim=0),
        spread=chosen([one.spread for one in looks]),
        summary=chosen([one.summary for one in looks]),
    )


def _together(look: Callable[[Images], Look], crops: Sequence[Images]) -> list[Look]:
    """Look at several crops of each hand in one batch, which is faster for a few hands."""
    seen, count = look(torch.cat(list(crops))), len(crops)
    parts = zip(
        seen.landmarks.chunk(count),
        seen.spread.chunk(count),
        seen.summary.chunk(count),
        strict=True,
    )
    return [Look(*part) for part in parts]


def _turn(angle: Float[Tensor, ""], size: int) -> Float[Tensor, "3 3"]:
    """Rotation about the middle of a crop, from x towards y; matrix from old to new pixels."""
    matrix = torch.eye(3, dtype=angle.dtype, device=angle.device)
    cosine, sine = torch.cos(angle), torch.sin(angle)
    matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1] = cosine, -sine, sine, cosine
    matrix[:2, 2] = size / 2 - matrix[:2, :2].sum(dim=-1) * size / 2
    return matrix


def _back(
    points: Float[Tensor, "batch landmark 2"], matrices: Float[Tensor, "batch 3 3"]
) -> Float[Tensor, "batch landmark 2"]:
    return move_points(points, torch.linalg.inv(matrices))
