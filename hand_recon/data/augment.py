"""Batched augmentation: pixels, 2D labels, 3D ground truth and camera move together (Sec. 4.1).

The paper scales the four sides of the box independently and pads to a square; here that box is one
draw of a similarity transform of the crop, beside the rotation, scale and shift that peers use.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from hand_recon.schema import HandBatch


@dataclass(frozen=True)
class CropMotion:
    """How each crop of a batch moves, and what that does to the hand in front of the camera."""

    pixels: Float[Tensor, "batch 3 3"]
    """Pixels of the old crop → pixels of the new one."""
    camera: Float[Tensor, "batch 3 3"]
    """Points of the old camera frame → points of the new one."""
    scale: Float[Tensor, " batch"]
    """Length in the new crop of what was one pixel long."""


@dataclass(frozen=True)
class Augmentation:
    """What may change in training; every range is symmetric about no change.

    A landmark that leaves the crop stays labelled: where it is can be inferred, and without it the
    hand's size could not be.

    Raises:
        ValueError: A range makes no sense.
    """

    rotation: float = 0.5236
    """Largest turn about the crop's centre, radians (30°)."""
    scale: float = 0.2
    """Largest relative change of the hand's size."""
    shift: float = 0.05
    """Largest shift along each axis, as a share of the crop's side."""
    side_jitter: float = 0.0
    """Each side of the box moves by up to this share of half the crop, as in the paper."""
    colour: float = 0.2
    """Largest relative change of each colour channel."""
    brightness: float = 0.1
    """Largest relative change of all channels together."""
    flip: float = 0.0
    """Probability of a mirror image. Zero: a right hand's model cannot match a left hand."""

    def __post_init__(self) -> None:
        limits = {"scale": 0.9, "side_jitter": 0.9, "colour": 1.0, "brightness": 1.0, "flip": 1.0}
        for name, value in vars(self).items():
            if not 0 <= value <= limits.get(name, float("inf")):
                raise ValueError(
                    f"Augmentation {name}={value} must lie between 0 and {limits.get(name, '∞')}."
                )

    def __call__(self, batch: HandBatch, generator: torch.Generator | None = None) -> HandBatch:
        """A new batch of the same hands, seen otherwise, with the image as floats 0–1.

        Args:
            batch: What a dataset gave, on any device.
            generator: Source of the draws, on the CPU so that they are the same on every device.
        """
        motion = self.draw_motion(len(batch), batch.crop_size, generator)
        motion = replace(
            motion,
            pixels=motion.pixels.to(batch.landmarks_2d),
            camera=motion.camera.to(batch.landmarks_2d),
            scale=motion.scale.to(batch.landmarks_2d),
        )
        moved = move(to_float(batch), motion)
        gain = self._draw_gain(len(batch), generator).to(moved.image)
        return replace(moved, image=moved.image.mul_(gain).clamp_(0, 1))

    def draw_motion(
        self, count: int, crop_size: int, generator: torch.Generator | None = None
    ) -> CropMotion:
        """Draw how each crop moves.

        Args:
            count: Number of crops.
            crop_size: Side of a crop, pixels.
            generator: Source of the draws.
        """
        angle, zoom, across, down, *sides = _symmetric((8, count), generator)
        flipped = torch.rand(count, generator=generator) < self.flip
        left, top, right, bottom = (1 + self.side_jitter * side for side in sides)
        # Half the larger extent of the jittered box, in units of half the crop, is the new square.
        scale = (1 + self.scale * zoom) * 2 / torch.maximum(left + right, top + bottom)
        box = torch.stack([right - left, bottom - top], dim=-1) * crop_size / 4
        shift = torch.stack([across, down], dim=-1) * self.shift * crop_size
        camera = _turn(self.rotation * angle, flipped)
        centre = torch.full((count, 2), crop_size / 2)
        linear = scale[:, None, None] * camera[:, :2, :2]
        offset = centre + shift - (linear @ (centre + box)[..., None])[..., 0]
        pixels = torch.eye(3).repeat(count, 1, 1)
        pixels[:, :2] = torch.cat([linear, offset[..., None]], dim=-1)
        return CropMotion(pixels=pixels, camera=camera, scale=scale)

    def _draw_gain(
        self, count: int, generator: torch.Generator | None
    ) -> Float[Tensor, "batch channel 1 1"]:
        draws = _symmetric((count, 4, 1, 1), generator)
        return (1 + self.colour * draws[:, :3]) * (1 + self.brightness * draws[:, 3:])


def move(batch: HandBatch, motion: CropMotion) -> HandBatch:
    """Move everything a batch knows of its hands, so that projections stay exact.

    With A the motion of pixels and G that of the camera frame, K' = A K G⁻¹, so that
    K' (G X) = A (K X).

    Args:
        batch: With the image as floats; what leaves it is black.
        motion: One per crop.
    """
    to_new = motion.camera.mT
    intrinsics = batch.intrinsics
    if intrinsics is not None:
        # G is orthogonal: its inverse is its transpose.
        intrinsics = motion.pixels @ intrinsics @ motion.camera.mT
    linear, offset = motion.pixels[:, :2, :2], motion.pixels[:, :2, 2]
    return replace(
        batch,
        image=warp(batch.image, motion.pixels) if batch.image.numel() else batch.image,
        landmarks_2d=batch.landmarks_2d @ linear.mT + offset[:, None],
        intrinsics=intrinsics,
        landmarks_3d=None if batch.landmarks_3d is None else batch.landmarks_3d @ to_new,
        vertices=None if batch.vertices is None else batch.vertices @ to_new,
        label_noise=None
        if batch.label_noise is None
        else batch.label_noise * motion.scale[:, None],
    )


def warp(
    image: Float[Tensor, "batch channel height width"], pixels: Float[Tensor, "batch 3 3"]
) -> Float[Tensor, "batch channel height width"]:
    """Resample square images bilinearly, black outside.

    Args:
        image: Square.
        pixels: Where each pixel goes; pixel i covers [i, i + 1) as in `hand_recon.data.crop`.
    """
    size = image.shape[-1]
    to_pixels = pixels.new_tensor([[size / 2, 0, size / 2], [0, size / 2, size / 2], [0, 0, 1]])
    # The grid asks where each new pixel comes from, in units in which the image spans [−1, 1].
    source = (torch.linalg.inv(pixels @ to_pixels) @ to_pixels)[:, :2].to(image)
    centres = (torch.arange(size, device=image.device, dtype=image.dtype) + 0.5) * 2 / size - 1
    # An outer sum: on a CPU fifty times faster than `affine_grid`, which multiplies matrices.
    rows = source[..., 1:2] * centres + source[..., 2:]
    grid = source[..., 0, None, None] * centres + rows[..., None]
    return functional.grid_sample(image, grid.permute(0, 2, 3, 1), align_corners=False)


def to_float(batch: HandBatch) -> HandBatch:
    """The same batch with its image as floats 0–1, or the batch itself if they are."""
    if batch.image.dtype != torch.uint8:
        return batch
    return replace(batch, image=batch.image.float().div_(255))


def _symmetric(shape: tuple[int, ...], generator: torch.Generator | None) -> Float[Tensor, "..."]:
    """Uniform draws from [−1, 1)."""
    return 2 * torch.rand(shape, generator=generator) - 1


def _turn(
    angle: Float[Tensor, " batch"], flipped: Bool[Tensor, " batch"]
) -> Float[Tensor, "batch 3 3"]:
    """Rotation about the optical axis after an optional mirror image left to right."""
    cosine, sine = torch.cos(angle), torch.sin(angle)
    mirror = torch.where(flipped, -1.0, 1.0)
    turn = torch.zeros(len(angle), 3, 3)
    turn[:, 0, 0], turn[:, 0, 1] = cosine * mirror, -sine
    turn[:, 1, 0], turn[:, 1, 1] = sine * mirror, cosine
    turn[:, 2, 2] = 1
    return turn
