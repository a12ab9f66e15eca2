"""Camera matrix of a photograph: given, from EXIF, from a field of view, or assumed."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.camera import REFERENCE_FOCAL, REFERENCE_SIZE
from hand_recon.data.landmarks.camera_files import CameraFile, read_camera_file
from hand_recon.data.landmarks.cameras import with_camera_of
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks

CHOICES: Final = ("auto", "exif", "assumed")
"""Choices of a camera besides `fov=<degrees>` and a file of camera matrices."""

ASSUMED_FOCAL: Final = 1.2
"""Assumed focal length as a multiple of the longer side: a field of view of 45°."""

_EXPANSION: Final = 1.5
_FIELD: Final = re.compile(r"fov=(?P<degrees>.+)")


@dataclass(frozen=True)
class PhotoCamera:
    """Camera matrix of one photograph."""

    matrix: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels of the upright photograph."""
    source: str
    """Source of the matrix, one of `hand_recon.fitting.hand_records.CAMERAS`."""


@dataclass(frozen=True)
class CameraChoice:
    """Rule by which the camera of each photograph of a command is determined."""

    name: str = "auto"
    """`auto` (EXIF if it has a focal length, else assumed), `exif`, `assumed`, `fov` or `file`."""
    degrees: float = math.nan
    """Field of view of the longer side, degrees, for `fov`."""
    path: Path | None = None
    """The file of cameras, for `file`; None for matrices that were given as arrays."""
    cameras: CameraFile | None = None
    """Camera of all photographs or of each, for `file`."""

    def of_photo(
        self,
        size: tuple[int, int],
        focal_px: float | None,
        hand_sides: Float[np.ndarray, " hand"],
    ) -> PhotoCamera:
        """Camera of one photograph without a file of cameras.

        Args:
            size: Width and height, pixels.
            focal_px: Focal length by EXIF, pixels; None without one.
            hand_sides: Longer side of each hand's box, pixels.

        Raises:
            ValueError: EXIF is asked for and has no focal length.
        """
        if self.name == "fov":
            focal = max(size) / 2 / math.tan(math.radians(self.degrees) / 2)
            return PhotoCamera(centred_camera(focal, size), "field of view")
        if focal_px is not None and self.name in ("auto", "exif"):
            return PhotoCamera(centred_camera(focal_px, size), "EXIF")
        if self.name == "exif":
            raise ValueError(
                "EXIF has no focal length for this image; use camera=auto, camera=fov=<degrees> or "
                "camera=<file>."
            )
        return PhotoCamera(centred_camera(assumed_focal(size, hand_sides), size), "assumed")


def assumed_focal(size: tuple[int, int], hand_sides: Float[np.ndarray, " hand"]) -> float:
    """Focal length that is assumed of a photograph without further information, pixels.

    `ASSUMED_FOCAL` times the longer side. A hand that fills most of the photograph would then be nearer than
    people hold a camera: such photographs are mostly cut from larger ones. The focal length is at least the
    one that a crop about the largest hand is given elsewhere, 500 px on 224 px.

    Args:
        size: Width and height, pixels.
        hand_sides: Longer side of each hand's box, pixels.
    """
    crop = _EXPANSION * float(hand_sides.max(initial=0.0))
    return max(ASSUMED_FOCAL * max(size), REFERENCE_FOCAL / REFERENCE_SIZE * crop)


def centred_camera(focal: float, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """Camera matrix with the principal point in the middle and square pixels.

    Args:
        focal: Focal length, pixels.
        size: Width and height, pixels.
    """
    width, height = size
    return np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])


def parse_camera(text: str, photos: int) -> CameraChoice:
    """Read the choice of a camera.

    Args:
        text: `auto`, `exif`, `assumed`, `fov=<degrees>`, or a file with one camera matrix for all photographs
            or one for each.
        photos: Number of photographs.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The field of view is no angle, or the file has no camera matrices.
    """
    if text in CHOICES:
        return CameraChoice(text)
    field = _FIELD.fullmatch(text)
    if field is not None:
        return CameraChoice("fov", degrees=_degrees(field["degrees"]))
    path = Path(text).expanduser()
    if not path.is_file():
        raise FileNotFoundError(
            f"camera={text} is neither auto, exif, assumed, fov=<degrees> nor a file; expected one of them, "
            "for example camera=fov=60 or camera=K.json."
        )
    cameras = read_camera_file(path, None)
    if len(cameras.matrices) not in (1, photos):
        raise ValueError(
            f"{path} holds {len(cameras.matrices)} cameras for {photos} photographs; expected one for all or "
            "one for each in their order."
        )
    return CameraChoice("file", path=path, cameras=cameras)


def _degrees(text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not 1 <= degrees <= 170:
        raise ValueError(
            f"camera=fov={text} is no field of view; expected the angle of the longer side in degrees, 1 to "
            "170, for example camera=fov=60."
        )
    return degrees


def given_cameras(matrices: Float[np.ndarray, "camera 3 3"]) -> CameraChoice:
    """Cameras that are given as arrays, pixels of the photographs: one for all, or one for each.

    Args:
        matrices: The camera matrices.
    """
    count = len(matrices)
    unknown = np.full((count, 2), np.nan)
    cameras = CameraFile(matrices, ((),) * count, (False,) * count, unknown)
    return CameraChoice("file", cameras=cameras)


def with_given_camera(
    landmarks: ImageLandmarks, choice: CameraChoice, number: int
) -> ImageLandmarks:
    """Landmarks of one photograph with its camera of a file: in its pixels, without lens distortion.

    Args:
        landmarks: The photograph's hands.
        choice: A choice with cameras.
        number: Index of the photograph among all.

    Raises:
        ValueError: The choice has no cameras, or the camera does not belong to this photograph.
    """
    if choice.cameras is None:
        raise ValueError(f"Found no file of cameras in camera={choice.name}; expected one.")
    count = len(choice.cameras.matrices)
    which = np.full(len(landmarks), number if count > 1 else 0)
    return with_camera_of(landmarks, choice.path or Path("camera"), choice.cameras, which)
