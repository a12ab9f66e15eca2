"""Batched augmentation: pixels, 2D labels, 3D ground truth and camera move together (Sec. 4.1).

The paper scales the four sides of the box independently and pads to a square; here that box is one
draw of a similarity transform of the crop, next to the rotation, scale and translation that peers use.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.camera import move_pixels, move_points
from hand_recon.data.appearance import Appearance
from hand_recon.data.copies import on_device_of
from hand_recon.schema import CropMotion, HandBatch


@dataclass(frozen=True)
class Augmentation:
    """Random augmentation of training batches; every range is symmetric about no change.

    A landmark outside the new crop keeps its label: its position can be inferred, and the hand's size
    depends on it.

    Raises:
        ValueError: A value is outside its limits.
    """

    rotation: float = 0.5236
    """Largest rotation about the crop's centre, radians (30°)."""
    scale: float = 0.2
    """Largest relative change of the hand's size."""
    shift: float = 0.05
    """Largest translation along each axis, as a share of the crop's side."""
    side_jitter: float = 0.0
    """Largest displacement of each side of the box, as a share of half the crop (the paper's)."""
    colour: float = 0.2
    """Largest relative change of each colour channel."""
    brightness: float = 0.1
    """Largest relative change of all channels together."""
    flip: float = 0.0
    """Probability of a horizontal flip; 0 by default, as a right hand's model cannot match a left hand."""
    appearance: Appearance | None = None
    """Further changes of the image; None for none."""

    def __post_init__(self) -> None:
        limits = {
            "scale": 0.9,
            "side_jitter": 0.9,
            "colour": 1.0,
            "brightness": 1.0,
            "flip": 1.0,
        }
        for name, value in vars(self).items():
            if name != "appearance" and not 0 <= value <= limits.get(name, float("inf")):
                raise ValueError(
                    f"Augmentation {name}={value} must lie between 0 and {limits.get(name, '∞')}."
                )

    def __call__(self, batch: HandBatch, generator: torch.Generator | None = None) -> HandBatch:
        """A randomly transformed copy of a batch, with the image as floats 0–1.

        Args:
            batch: Batch of a dataset, on any device.
            generator: Source of the draws, on the CPU so that they are the same on every device.
        """
        motion = self.draw_motion(len(batch), batch.crop_size, generator)
        motion = replace(
            motion,
            pixels=on_device_of(motion.pixels, batch.landmarks_2d),
            camera=on_device_of(motion.camera, batch.landmarks_2d),
            scale=on_device_of(motion.scale, batch.landmarks_2d),
        )
        batch = to_float(batch)
        appearance = self.appearance if batch.image.numel() else None
        if appearance is not None:
            batch = replace(batch, image=appearance.fill_outside(batch.image, generator))
        moved = move(batch, motion)
        gain = on_device_of(self._draw_gain(len(batch), generator), moved.image)
        image = moved.image.mul_(gain).clamp_(0, 1)
        return replace(moved, image=image if appearance is None else appearance(image, generator))

    def draw_motion(
        self, count: int, crop_size: int, generator: torch.Generator | None = None
    ) -> CropMotion:
        """Draw a random transform for each crop.

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
        camera = _camera_rotation(self.rotation * angle, flipped)
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
    """Transform image, labels, 3D points and camera of a batch, so that projections stay exact.

    With A the transform of pixels and G the rotation of the camera frame, K' = A K G⁻¹, so that
    K' (G X) = A (K X).

    Args:
        batch: Batch with the image as floats; the outside of the image is black.
        motion: Transforms, one per crop.
    """
    to_new = motion.camera.mT
    intrinsics = batch.intrinsics
    if intrinsics is not None:
        # G is orthogonal: its inverse is its transpose.
        intrinsics = motion.pixels @ intrinsics @ motion.camera.mT
    return replace(
        batch,
        image=move_pixels(batch.image, motion.pixels) if batch.image.numel() else batch.image,
        landmarks_2d=move_points(batch.landmarks_2d, motion.pixels),
        intrinsics=intrinsics,
        landmarks_3d=None if batch.landmarks_3d is None else batch.landmarks_3d @ to_new,
        vertices=None if batch.vertices is None else batch.vertices @ to_new,
        label_noise=None
        if batch.label_noise is None
        else batch.label_noise * motion.scale[:, None],
    )


def to_float(batch: HandBatch) -> HandBatch:
    """The same batch with its image as floats 0–1; the batch itself if it has floats already."""
    if batch.image.dtype != torch.uint8:
        return batch
    return replace(batch, image=batch.image.float().div_(255))


def _symmetric(shape: tuple[int, ...], generator: torch.Generator | None) -> Float[Tensor, "..."]:
    """Uniform draws from [−1, 1)."""
    return 2 * torch.rand(shape, generator=generator) - 1


def _camera_rotation(
    angle: Float[Tensor, " batch"], flipped: Bool[Tensor, " batch"]
) -> Float[Tensor, "batch 3 3"]:
    """Rotation about the optical axis after an optional horizontal flip."""
    cosine, sine = torch.cos(angle), torch.sin(angle)
    mirror = torch.where(flipped, -1.0, 1.0)
    rotation = torch.zeros(len(angle), 3, 3)
    rotation[:, 0, 0], rotation[:, 0, 1] = cosine * mirror, -sine
    rotation[:, 1, 0], rotation[:, 1, 1] = sine * mirror, cosine
    rotation[:, 2, 2] = 1
    return rotation
