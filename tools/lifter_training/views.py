"""Views of hands as a detector gives them: any direction, any camera, noise that runs along a finger."""

import math
from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import REFERENCE_SIZE, move_points, project
from hand_recon.hand.skeleton import FINGERS
from hand_recon.hand.upright import upright_motion
from hand_recon.schema import HandBatch

_FINGER: Final = torch.tensor([0] + [1 + place // 4 for place in range(20)])
"""Part of each landmark: the wrist, or one of the five fingers, whose landmarks share some of their noise."""

_ALONG: Final = torch.tensor([0.6] + [0.7, 0.8, 1.0, 1.3] * len(FINGERS))
"""Noise of each landmark relative to the hand's: detectors place the wrist best and tips worst."""

_SHARED: Final = 0.65
"""Share of the noise that the landmarks of a finger have in common; its square is that of the variance."""


@dataclass(frozen=True)
class Noise:
    """Noise of the landmarks and missing ones.

    MediaPipe's landmarks are off by 6.9 px of 256 on average on living hands, which is a σ of 4.8 px of 224.
    """

    sigma: tuple[float, float] = (0.7, 6.0)
    """Least and greatest σ of a hand's landmarks, pixels of a 224-pixel crop; the logarithm is uniform."""
    missing: float = 0.15
    """Mean share of a hand's landmarks that are missing."""
    focal: tuple[float, float] = (350.0, 1000.0)
    """Least and greatest focal length, pixels of a 224-pixel crop; the logarithm is uniform."""
    off_centre: float = 60.0
    """Greatest distance of the hand from the optical axis along u and v, pixels at a focal length of 500."""
    fill: tuple[float, float] = (0.55, 0.85)
    """Least and greatest side of the hand's bounding square, as a share of the crop."""


@dataclass(frozen=True)
class Views:
    """Views of hands in upright crops of 224 pixels."""

    seen: HandBatch
    """Noisy landmarks with their camera, some missing: what a lifter gets."""
    exact: Float[Tensor, "hand landmark=21 2"]
    """Exact projections of all landmarks, the 2D labels."""
    points: Float[Tensor, "hand landmark=21 3"]
    """Landmarks in the camera's frame, metres. A label only where the lifter itself made the hand."""


def sample_views(
    hands: Float[Tensor, "hand landmark=21 3"], noise: Noise, generator: torch.Generator
) -> Views:
    """Look at each hand once, from a random direction.

    Args:
        hands: Landmarks in the hand's frame, metres.
        noise: Settings.
        generator: Source of the draws.
    """
    turned = hands @ random_rotations(len(hands), generator).mT
    points, camera = _placed(turned, noise, generator)
    exact = project(points, camera)
    noisy = exact + _detector_noise(points, exact, noise, generator)
    labelled = _given(len(hands), noise, generator)
    motion = upright_motion(noisy, labelled, int(REFERENCE_SIZE))
    seen = HandBatch(
        image=torch.empty(len(hands), 3, 0, 0),
        landmarks_2d=move_points(noisy, motion.pixels),
        labelled=labelled,
        index=torch.arange(len(hands)),
        source=("",) * len(hands),
        intrinsics=motion.pixels @ camera @ motion.camera.mT,
    )
    return Views(seen, move_points(exact, motion.pixels), points @ motion.camera.mT)


def random_rotations(count: int, generator: torch.Generator) -> Float[Tensor, "hand 3 3"]:
    """Draw rotations, uniform over all of them, from Gaussian quaternions."""
    quaternion = torch.randn(count, 4, generator=generator)
    w, x, y, z = torch.nn.functional.normalize(quaternion, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def _placed(
    points: Float[Tensor, "hand landmark=21 3"], noise: Noise, generator: torch.Generator
) -> tuple[Float[Tensor, "hand landmark=21 3"], Float[Tensor, "hand 3 3"]]:
    """Move rotated hands before cameras so that they fill the crop; points in the camera's frame, cameras."""
    count, middle = len(points), REFERENCE_SIZE / 2
    focal = _log_uniform(noise.focal, count, generator)
    shift = (2 * torch.rand(count, 2, generator=generator) - 1) * noise.off_centre / 500
    low, high = noise.fill
    side = REFERENCE_SIZE * (low + torch.rand(count, generator=generator) * (high - low))
    extent = (points[..., :2].amax(dim=1) - points[..., :2].amin(dim=1)).amax(dim=-1)
    depth = (focal * extent / side).clamp(min=0.15)
    translation = torch.cat([shift * depth[:, None], depth[:, None]], dim=-1)
    placed = points + translation[:, None]
    nearest = placed[..., 2].amin(dim=1)
    placed[..., 2] += (0.1 - nearest).clamp(min=0)[:, None]
    camera = torch.zeros(count, 3, 3)
    camera[:, 0, 0] = camera[:, 1, 1] = focal
    camera[:, :2, 2] = middle - shift * focal[:, None]
    camera[:, 2, 2] = 1
    return placed, camera


def _detector_noise(
    points: Float[Tensor, "hand landmark=21 3"],
    exact: Float[Tensor, "hand landmark=21 2"],
    noise: Noise,
    generator: torch.Generator,
) -> Float[Tensor, "hand landmark=21 2"]:
    """Noise of landmarks, pixels: one size per hand, larger for tips and for what is far from the camera."""
    count = len(points)
    # σ is meant for a hand that fills 0.7 of the crop, as upright crops do.
    size = (exact.amax(dim=1) - exact.amin(dim=1)).amax(dim=-1) / (0.7 * REFERENCE_SIZE)
    sigma = _log_uniform(noise.sigma, count, generator) * size
    behind = ((points[..., 2] - points[..., 2].mean(dim=1, keepdim=True)) / 0.04).clamp(0, 1)
    each = sigma[:, None] * _ALONG * (0.8 + 0.6 * behind)
    shared = torch.randn(count, 6, 2, generator=generator)[:, _FINGER]
    own = torch.randn(count, 21, 2, generator=generator)
    return each[..., None] * (_SHARED * shared + math.sqrt(1 - _SHARED**2) * own)


def _given(
    count: int, noise: Noise, generator: torch.Generator
) -> Bool[Tensor, "hand landmark=21"]:
    """Mask of the landmarks that are given; a hand's missing share is from 0 to twice the mean."""
    share = 2 * noise.missing * torch.rand(count, 1, generator=generator)
    return torch.rand(count, 21, generator=generator) >= share


def _log_uniform(
    bounds: tuple[float, float], count: int, generator: torch.Generator
) -> Float[Tensor, " hand"]:
    low, high = (math.log(bound) for bound in bounds)
    return (low + torch.rand(count, generator=generator) * (high - low)).exp()
