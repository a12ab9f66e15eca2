"""Small photographs of three colours, and their EXIF."""

from importlib.util import find_spec

import numpy as np
import pytest
from PIL import ExifTags, Image, features

RED, BLUE, GREEN = (220, 20, 20), (20, 20, 220), (10, 160, 40)

HEIC_ROTATED = (
    "AAAAHGZ0eXBoZWljAAAAAG1pZjFoZWljbWlhZgAAAchtZXRhAAAAAAAAACFoZGxyAAAAAAAAAABwaWN0AAAAAAAAAAAAAAAAAAAA"
    "ADRpbG9jAAAAAERAAAIAAQAAAAAB7AABAAAAAAAAAEEAAgAAAAACLQABAAAAAAAAAEIAAAA4aWluZgAAAAAAAgAAABVpbmZlAgAA"
    "AAABAABodmMxAAAAABVpbmZlAgAAAQACAABFeGlmAAAAAA5waXRtAAAAAAABAAABB2lwcnAAAADmaXBjbwAAAHZodmNDAQNwAAAA"
    "kAAAAAAAHvAA/P34+AAADwNgAAEAGEABDAH//wNwAAADAJAAAAMAAAMAHroCQGEAAQAqQgEBA3AAAAMAkAAAAwAAAwAeoCCBBZbq"
    "5Ka5uAhoMCAAAAMDIAAAAwAhYgABAAZEAcFzwIkAAAATY29scm5jbHgAAQANAAaAAAAAFGlzcGUAAAAAAAAAQAAAAEAAAAAoY2xh"
    "cAAAADAAAAABAAAAIAAAAAH////wAAAAAv///+AAAAACAAAAEHBpeGkAAAAAAwgICAAAAAlpcm90AwAAABlpcG1hAAAAAAAAAAEA"
    "AQaBAgMFhIYAAAAaaXJlZgAAAAAAAAAOY2RzYwACAAEAAQAAAIttZGF0AAAAPSgBr1j5FOf/uyt/RioaLSc71boKUTQz6c6FqmWt"
    "2et4QqfnmtJXP/bZb48oeQJG5voozbctasMSLbqK4/AAAAAGRXhpZgAATU0AKgAAAAgAAgESAAMAAAABAAYAAIdpAAQAAAABAAAA"
    "JgAAAAAAAaQFAAMAAAABABoAAAAAAAA="
)
"""A made-up HEIC image of 48 × 32 pixels, orientation 6, 26 mm on film: red and blue corners on white."""

HAS_HEIF = find_spec("pi_heif") is not None

AVIF = pytest.param(
    "avif",
    marks=pytest.mark.skipif(
        "avif" not in features.get_supported(), reason="this Pillow has no AVIF"
    ),
)
"""AVIF as a parameter of tests: Pillow reads it from 11.3 on."""

needs_heif = pytest.mark.skipif(not HAS_HEIF, reason="pi-heif is not installed")


def corners(height: int = 32, width: int = 48) -> np.ndarray:
    """White with red at the top left and green at the top right; no two orientations look alike."""
    pixels = np.full((height, width, 3), 255, dtype=np.uint8)
    pixels[: height // 2, : width // 2] = RED
    pixels[: height // 2, width // 2 :] = GREEN
    return pixels


def exif_of(**tags: float) -> Image.Exif:
    """EXIF with tags by their names in Pillow, those of the camera in the IFD where they belong."""
    exif = Image.Exif()
    camera = {ExifTags.Base[name]: value for name, value in tags.items() if name != "Orientation"}
    if "Orientation" in tags:
        exif[ExifTags.Base.Orientation] = tags["Orientation"]
    if camera:
        exif[ExifTags.IFD.Exif] = camera
    return exif


def near(pixels: np.ndarray, expected: np.ndarray, tolerance: int = 12) -> bool:
    """True if the middles of the four quarters agree, away from edges where compression rings."""
    height, width, _ = expected.shape
    assert pixels.shape == expected.shape
    return all(
        np.abs(pixels[y, x].astype(int) - expected[y, x]).max() <= tolerance
        for y in (height // 4, 3 * height // 4)
        for x in (width // 4, 3 * width // 4)
    )
