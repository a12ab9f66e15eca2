"""Random changes of a training crop's appearance; labels stay as they are (Sec. 4.1)."""

from dataclasses import dataclass
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from hand_recon.data.copies import on_device_of

SMALLEST_PATCH: Final = 0.08
"""Side of the smallest patch, as a share of the crop's."""


@dataclass(frozen=True)
class Appearance:
    """Background outside of the image, contrast, grey, blur, sensor noise and occluding patches.

    What a network learns from a few thousand tight crops must hold for photographs of another origin.

    Raises:
        ValueError: A value is outside its limits.
    """

    outside: float = 0.5
    """Probability that the part of a crop outside of its image, black otherwise, shows another crop of the
    batch or its mean colour: tight crops would tell the network where the hand ends."""
    contrast: float = 0.3
    """Largest relative change of the contrast."""
    grey: float = 0.1
    """Probability of a grey image."""
    blur: float = 0.2
    """Probability of an image of half the resolution."""
    noise: float = 0.02
    """Largest standard deviation of the sensor noise, as a share of white."""
    patches: float = 0.5
    """Probability of a rectangle of one colour, or of another crop, over the hand."""
    patch_side: float = 0.38
    """Largest side of such a rectangle, as a share of the crop's."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value <= 1:
                raise ValueError(f"Appearance {name}={value} must lie between 0 and 1.")

    def fill_outside(
        self,
        image: Float[Tensor, "batch 3 height width"],
        generator: torch.Generator | None = None,
    ) -> Float[Tensor, "batch 3 height width"]:
        """Fill what lies outside of the images, recognized by exact black.

        Args:
            image: Crops before any other change, 0–1.
            generator: Source of the draws.
        """
        draws = on_device_of(torch.rand(len(image), 1, 1, 1, generator=generator), image)
        black = (image.sum(dim=1, keepdim=True) == 0) & (draws < self.outside)
        other = image.roll(1, dims=0)
        mean = other.mean(dim=(2, 3), keepdim=True)
        return torch.where(black, torch.where(draws < self.outside / 2, other, mean), image)

    def __call__(
        self,
        image: Float[Tensor, "batch 3 height width"],
        generator: torch.Generator | None = None,
    ) -> Float[Tensor, "batch 3 height width"]:
        """Changed copies of the crops, 0–1.

        Args:
            image: Crops, 0–1.
            generator: Source of the draws, on the CPU so that most are the same on every device.
        """
        count = len(image)
        draws = on_device_of(torch.rand(4, count, 1, 1, 1, generator=generator), image)
        small = functional.avg_pool2d(image, 2)
        blurred = functional.interpolate(small, image.shape[-2:], mode="bilinear")
        image = torch.where(draws[0] < self.blur, blurred, image)
        image = torch.where(draws[1] < self.grey, image.mean(dim=1, keepdim=True), image)
        # As additions, so that nothing is rounded where nothing is to change.
        mean = image.mean(dim=(1, 2, 3), keepdim=True)
        image = image + (image - mean) * (self.contrast * (2 * draws[2] - 1))
        if self.noise:
            noise = on_device_of(torch.randn(image.shape, generator=generator), image)
            image = image + self.noise * draws[3] * noise
        return self._with_patches(image, generator).clamp_(0, 1)

    def _with_patches(self, image: Tensor, generator: torch.Generator | None) -> Tensor:
        count, size = len(image), image.shape[-1]
        draws = on_device_of(torch.rand(count, 9, generator=generator), image)
        sides = SMALLEST_PATCH + (self.patch_side - SMALLEST_PATCH) * draws[:, :2]
        inside = _rectangle(draws[:, 2:4] * (1 - sides), sides, size)
        chosen = (draws[:, 4] < self.patches)[:, None, None, None]
        colour = draws[:, 5:8, None, None].expand_as(image)
        content = torch.where(draws[:, 8, None, None, None] < 0.5, image.flip(0), colour)
        return torch.where(inside & chosen, content, image)


def _rectangle(
    corner: Float[Tensor, "batch 2"], sides: Float[Tensor, "batch 2"], size: int
) -> Bool[Tensor, "batch 1 size size"]:
    """True inside a rectangle of each crop, given in shares of the crop's side."""
    centres = (torch.arange(size, device=corner.device) + 0.5) / size
    low, high = corner[..., None], (corner + sides)[..., None]
    within = (centres >= low) & (centres < high)
    return (within[:, 0, None, :] & within[:, 1, :, None])[:, None]
