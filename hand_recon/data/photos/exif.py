"""Facts of a photograph's EXIF metadata: orientation and focal length.

Tags are those of the EXIF standard (CIPA DC-008).
"""

import math
from dataclasses import dataclass
from typing import Final, SupportsFloat, SupportsIndex

import numpy as np
from jaxtyping import UInt8
from PIL import ExifTags, Image

FILM_DIAGONAL: Final = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film, 43.27 mm."""

_UNITS: Final = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Millimetres of the units of FocalPlaneResolutionUnit; 4 and 5 are used beyond the standard."""
_FOCAL_LENGTHS: Final = (4.0, 1000.0)
"""Focal lengths on 35 mm film that are taken for true, millimetres: fisheye to long telephoto lens."""
_SHAPES: Final = (1.2, 2.1)
"""Longer side by shorter side of cameras' images: from 5:4 to 18:9, with a margin."""
_SAME_FOCAL: Final = 0.2
"""Difference of two logarithms of focal lengths that rounding to whole millimetres explains."""
_SAME_SHAPE: Final = 0.02
"""Relative difference of two aspect ratios above which an image counts as cropped."""


@dataclass(frozen=True)
class Focal:
    """Focal length by EXIF."""

    film: float | None = None
    """Focal length on 35 mm film, as written in the file, millimetres."""
    pixels: float | None = None
    """Focal length in pixels of the stored image."""
    note: str = ""
    """Reason why EXIF names a focal length that is not used; "" without one."""


def orientation(image: Image.Image) -> int:
    """EXIF's orientation, 1 to 8; 1 if it is missing, damaged or none of these."""
    # The HEIF reader rotates by itself and keeps the number here.
    found = image.info.get("original_orientation") or _exif(image).get(ExifTags.Base.Orientation)
    number = _number(found)
    return int(number) if number is not None and number in range(1, 9) else 1


def to_upright(
    stored: UInt8[np.ndarray, "_ _ 3"], orientation: int
) -> UInt8[np.ndarray, "height width 3"]:
    """Rotate and mirror pixels by EXIF's orientation; a view of the same memory.

    Args:
        stored: Pixels as stored.
        orientation: 1 to 8: 2 is mirrored, 3 rotated by 180°, 6 needs a quarter turn clockwise, 8 one
            anticlockwise; 4, 5 and 7 are their mirror images.
    """
    # The even ones of the first four and the odd ones of the last are mirrored.
    mirrored = orientation in (2, 4, 5, 7)
    turns = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 3, 7: 3, 8: 1}[orientation]
    rotated = np.rot90(stored, turns)
    return (
        rotated[:, ::-1] if mirrored and turns % 2 == 0 else rotated[::-1] if mirrored else rotated
    )


def focal(image: Image.Image) -> Focal:
    """Focal length in pixels: by the sensor's resolution, else by the film's diagonal.

    An image that was scaled down has its focal length scaled. It is not known, with a note that says why, if
    the image was cropped, as its shape tells: another than EXIF records, or one that no camera has; and if
    the two ways to compute it disagree, since then a program changed the size and the records of it.
    """
    try:
        details = dict(_exif(image).get_ifd(ExifTags.IFD.Exif))
    except Exception:  # noqa: BLE001  # damaged metadata raise anything, and are no reason to refuse
        return Focal()
    film = _number(details.get(ExifTags.Base.FocalLengthIn35mmFilm))
    film = film if film and _FOCAL_LENGTHS[0] <= film <= _FOCAL_LENGTHS[1] else None
    scale, diagonal = _scale(details, image.size), math.hypot(*image.size)
    by_film = None if film is None else film * diagonal / FILM_DIAGONAL
    by_sensor = _pixels_by_sensor(details, diagonal, scale or 1.0)
    pixels = by_film if by_sensor is None else by_sensor
    if pixels is None:
        return Focal(film)
    if reason := _reason_for_doubt(image.size, scale, by_film, by_sensor):
        return Focal(film, None, f"{reason}, so that its focal length is not known.")
    return Focal(film, pixels)


def _reason_for_doubt(
    size: tuple[int, int], scale: float | None, by_film: float | None, by_sensor: float | None
) -> str:
    shape = max(size) / min(size)
    if scale is None:
        return "Its shape differs from the one that EXIF records: it was cropped"
    if not _SHAPES[0] <= shape <= _SHAPES[1]:
        return f"It is {shape:.2f} times as long as it is wide, unlike a camera's images: it was cropped"
    if by_film and by_sensor and abs(math.log(by_film / by_sensor)) > _SAME_FOCAL:
        return "EXIF's records of its lens and its sensor disagree: it was cropped or scaled"
    return ""


def _exif(image: Image.Image) -> Image.Exif:
    try:
        return image.getexif()
    except Exception:  # noqa: BLE001  # as above
        return Image.Exif()


def _scale(details: dict[int, object], size: tuple[int, int]) -> float | None:
    """Size of the file relative to the one recorded; 1 if none is recorded, None for another shape."""
    recorded_width = _number(details.get(ExifTags.Base.ExifImageWidth))
    recorded_height = _number(details.get(ExifTags.Base.ExifImageHeight))
    if not recorded_width or not recorded_height:
        return 1.0
    # Programs that rotate the pixels often keep the recorded width and height as they were.
    for width, height in (size, size[::-1]):
        if abs(math.log((width / height) / (recorded_width / recorded_height))) < _SAME_SHAPE:
            return width / recorded_width
    return None


def _pixels_by_sensor(details: dict[int, object], diagonal: float, scale: float) -> float | None:
    length = _number(details.get(ExifTags.Base.FocalLength))
    resolution = _number(details.get(ExifTags.Base.FocalPlaneXResolution))
    unit = _UNITS.get(int(_number(details.get(ExifTags.Base.FocalPlaneResolutionUnit)) or 2))
    if not length or not resolution or not unit:
        return None
    pixels = length * resolution / unit * scale
    low, high = _FOCAL_LENGTHS
    return pixels if low <= pixels / diagonal * FILM_DIAGONAL <= high else None


def _number(value: object) -> float | None:
    """A positive, finite number of a tag; None for anything else, as EXIF holds 0 for unknown."""
    if isinstance(value, tuple) and len(value) == 1:
        value = value[0]
    if not isinstance(value, SupportsFloat | SupportsIndex):
        return None
    try:
        number = float(value)
    except (ZeroDivisionError, OverflowError, ValueError):
        return None
    return number if math.isfinite(number) and number > 0 else None
