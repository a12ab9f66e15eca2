"""Bilinear sampling of a rotated square, point by point in NumPy."""

import math

import numpy as np
from jaxtyping import Float, UInt8

from hand_recon.detection.regions import Region


def sampled(
    image: UInt8[np.ndarray, "height width 3"], region: Region, size: int, steps: int | None = None
) -> Float[np.ndarray, "size size 3"]:
    """Grey levels of a crop, with the image's edge repeated outside, not rounded.

    Args:
        image: RGB, bytes.
        region: The square.
        size: Side of the crop, pixels.
        steps: Parts of a pixel to which sample points are rounded, as older versions of OpenCV do with 32.
    """
    height, width = image.shape[:2]
    crop = np.empty((size, size, 3))
    for row in range(size):
        for column in range(size):
            along, down = (
                (column / size - 0.5) * region.side,
                (row / size - 0.5) * region.side,
            )
            x = region.x + along * math.cos(region.rotation) - down * math.sin(region.rotation)
            y = region.y + along * math.sin(region.rotation) + down * math.cos(region.rotation)
            if steps:
                x, y = round(x * steps) / steps, round(y * steps) / steps
            left, top = math.floor(x), math.floor(y)
            value = np.zeros(3)
            for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
                weight = abs(1 - dx - (x - left)) * abs(1 - dy - (y - top))
                i = min(max(left + dx, 0), width - 1)
                j = min(max(top + dy, 0), height - 1)
                value += weight * image[j, i]
            crop[row, column] = value
    return crop
