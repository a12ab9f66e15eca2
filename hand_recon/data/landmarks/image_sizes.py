"""Sizes and EXIF orientations of image files (decision 58)."""

import warnings
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

ORIENTATION = 0x0112
"""EXIF's tag of the orientation: 1 upright, 3, 6 and 8 rotated, the others mirrored."""


@lru_cache(maxsize=100_000)
def stored_size(path: Path) -> tuple[int, int, int] | None:
    """Width and height of the raster of an image file, pixels, and its EXIF orientation, 1 to 8.

    The pixels are not decoded. None if there is no such file or it is no image.
    """
    try:
        with warnings.catch_warnings():
            # Nothing is decoded, so that the number of pixels is of no account.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                orientation = image.getexif().get(ORIENTATION, 1)
                width, height = image.size
    except Exception:  # noqa: BLE001  # a damaged image raises anything
        return None
    return width, height, orientation if orientation in range(1, 9) else 1


def upright_size(stored: tuple[int, int, int]) -> tuple[int, int]:
    """Width and height after rotation to the upright orientation."""
    width, height, orientation = stored
    return (height, width) if orientation >= 5 else (width, height)


def sizes_of_images(
    images: Sequence[Path | None], given: Float[np.ndarray, "hand 2"] | None, hands: int
) -> Float[np.ndarray, "hand 2"]:
    """Width and height of each hand's image, pixels; NaN where they are not known.

    Args:
        images: Image file of each hand; empty if there are none.
        given: Sizes that the landmark file gives, which go before those of the files on the disk.
        hands: Number of hands.
    """
    sizes = np.full((hands, 2), np.nan) if given is None else given.astype(np.float64)
    for hand, image in enumerate(images):
        stored = None if image is None or np.isfinite(sizes[hand]).all() else stored_size(image)
        if stored is not None:
            sizes[hand] = upright_size(stored)
    return sizes
