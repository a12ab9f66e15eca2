"""Camera files as tools write them: OpenCV, ROS, Kalibr, COLMAP, RealSense, Open3D, instant-ngp.

Each becomes one or more `CameraEntry`: a 3 × 3 matrix, its distortion and the size of its image.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.reading.text import parse_json, parse_yaml

MATRIX_KEYS: Final = (
    "K", "intrinsics", "camera_matrix", "cameraMatrix", "CameraMatrix", "intrinsic_matrix", "intrinsic",
    "mtx",
)  # fmt: skip
"""Keys of a camera matrix."""

DISTORTION_KEYS: Final = (
    "dist", "distortion", "distortion_coefficients", "distortion_coeffs", "dist_coeffs", "dist_coefs",
    "distCoeffs", "DistCoeffs", "distortionCoefficients", "coeffs", "D",
)  # fmt: skip
"""Keys of distortion coefficients."""

SIZE_KEYS: Final = ("image_size", "imageSize", "resolution", "img_size")
"""Keys of an image's width and height."""

WIDTH_HEIGHT: Final = (("width", "height"), ("image_width", "image_height"), ("w", "h"))
"""Pairs of keys of an image's width and height."""

FOCAL_KEYS: Final = (
    ("fx", "fy", "cx", "cy"), ("fl_x", "fl_y", "cx", "cy"), ("fx", "fy", "ppx", "ppy"),
    ("f", "f", "cx", "cy"),
)  # fmt: skip
"""Keys of focal lengths and principal points that are numbers of their own."""

MODEL_KEYS: Final = ("distortion_model", "camera_model", "model")
"""Keys of the distortion's model."""

FISHEYE: Final = ("equidistant", "fisheye", "kannala_brandt", "opencv_fisheye")
"""Names of OpenCV's fisheye model (Kannala and Brandt, TPAMI 2006)."""

BROWN: Final = (
    "plumb_bob", "radtan", "radial_tangential", "rational_polynomial", "brown_conrady", "pinhole", "opencv",
    "simple_radial", "radial", "simple_pinhole", "full_opencv", "perspective", "none", "",
)  # fmt: skip
"""Names of the model of OpenCV's `undistortPoints` (Brown, 1971), or of none."""

COLMAP: Final[Mapping[str, str]] = {
    "SIMPLE_PINHOLE": "f cx cy", "PINHOLE": "fx fy cx cy", "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2", "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4", "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
}  # fmt: skip
"""Parameters of COLMAP's models, in their order."""


@dataclass(frozen=True)
class CameraEntry:
    """One camera, or several with the same distortion, as a file has it."""

    matrix: Any
    """Values of the camera matrix or matrices, unchecked."""
    distortion: tuple[float, ...] = ()
    """Coefficients k1, k2, p1, p2, … of OpenCV; of fisheye cameras k1 to k4."""
    fisheye: bool = False
    """True for OpenCV's fisheye model."""
    size: tuple[float, float] | None = None
    """Width and height of the image that the matrix is for, pixels."""


def entries_of_json(path: Path, text: str) -> list[CameraEntry]:
    """Cameras of a JSON text.

    Raises:
        ValueError: It is not JSON, or holds something else.
    """
    return entries_of(path, parse_json(text, path))


def entries_of_yaml(path: Path, text: str) -> list[CameraEntry]:
    """Cameras of a YAML text: OpenCV's, ROS' or Kalibr's.

    Raises:
        ValueError: It is not YAML, or holds something else.
    """
    plain = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE).replace("!!opencv-matrix", "")
    return entries_of(path, parse_yaml(plain, path))


def entries_of_colmap(path: Path, text: str) -> list[CameraEntry]:
    """Cameras of COLMAP's `cameras.txt`: number, model, width, height and parameters in each line.

    Raises:
        ValueError: A model is unknown, or its parameters are of another number.
    """
    entries = []
    for line in text.splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) < 4 or words[1] not in COLMAP:
            raise ValueError(
                f"{path}: the line {line!r:.60} is no camera of COLMAP's with one of the models "
                f"{list(COLMAP)}."
            )
        names = COLMAP[words[1]].split()
        values = _numbers(path, words[2:])
        if len(values) != 2 + len(names):
            raise ValueError(
                f"{path}: {words[1]} has {len(values) - 2} parameters, expected {len(names)}: "
                f"{' '.join(names)}."
            )
        parameters = dict(zip(names, values[2:], strict=True))
        camera = {"w": values[0], "h": values[1], "model": words[1].lower(), **parameters}
        entries += entries_of(path, camera)
    return entries


def is_colmap(text: str) -> bool:
    """True if a line that is no comment has a model of COLMAP's as its second word."""
    lines = [line.split() for line in text.splitlines() if not line.lstrip().startswith("#")]
    return any(len(words) > 3 and re.fullmatch(r"[A-Z_]+", words[1]) for words in lines)


def entries_of(path: Path, content: Any) -> list[CameraEntry]:  # noqa: ANN401  # any JSON
    """Cameras of parsed JSON or YAML: matrices alone, one object, a list or an object of objects.

    Args:
        path: Their file, for messages.
        content: The parsed value.

    Raises:
        ValueError: It holds something else.
    """
    if isinstance(content, list):
        if content and all(isinstance(entry, dict) for entry in content):
            return [_entry(path, entry) for entry in content]
        return [CameraEntry(content)]
    if not isinstance(content, dict):
        raise ValueError(
            f"{path} holds {content!r:.40}; expected a camera matrix of 3 × 3 numbers."
        )
    if _has_camera(content):
        return [_entry(path, content)]
    inner = content.get("cameras", content)
    inner = list(inner.values()) if isinstance(inner, dict) else inner
    if isinstance(inner, list) and inner:
        cameras = [one for one in inner if isinstance(one, dict) and _has_camera(one)]
        if cameras:
            return [_entry(path, one) for one in cameras]
    raise ValueError(
        f"{path} is an object with the keys {sorted(map(str, content))[:10]}; expected one with `K` or "
        "`intrinsics`, with `fx`, `fy`, `cx` and `cy`, or the matrix alone."
    )


def _has_camera(content: Mapping[str, Any]) -> bool:
    return any(content.get(key) is not None for key in MATRIX_KEYS) or any(
        all(isinstance(content.get(key), int | float) for key in keys) for keys in FOCAL_KEYS
    )


def _entry(path: Path, content: Mapping[str, Any]) -> CameraEntry:
    if not _has_camera(content):
        raise ValueError(
            f"{path}: a camera has the keys {sorted(map(str, content))[:10]} and no `K` or `intrinsics`."
        )
    given = next((content[key] for key in MATRIX_KEYS if content.get(key) is not None), None)
    if isinstance(given, dict) and _has_camera(given):
        return _entry(path, {**content, **dict.fromkeys(MATRIX_KEYS), **given})
    matrix = _from_focal_lengths(content) if given is None else _matrix(given)
    distortion = _distortion(path, content)
    return CameraEntry(matrix, distortion, _is_fisheye(path, content, distortion), _size(content))


def _from_focal_lengths(content: Mapping[str, Any]) -> list[list[float]]:
    keys = next(keys for keys in FOCAL_KEYS if all(content.get(key) is not None for key in keys))
    fx, fy, cx, cy = (float(content[key]) for key in keys)
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]


def _matrix(given: Any) -> Any:  # noqa: ANN401  # any JSON
    """Rows of numbers of a matrix that a file has as an object, or as one flat list."""
    rows = given
    if isinstance(given, dict) and "data" in given:
        rows = given["data"]
    if not isinstance(rows, list) or not all(isinstance(one, int | float) for one in rows):
        return rows
    if len(rows) == 4:
        fx, fy, cx, cy = rows
        return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    side = {9: 3, 12: 4, 16: 4}.get(len(rows))
    if side is None:
        return rows
    matrix = [rows[start : start + side] for start in range(0, len(rows), side)]
    # Open3D writes its flat list column by column.
    by_columns = side == 3 and rows[2] == rows[5] == 0 and rows[6] != 0
    return [list(column) for column in zip(*matrix, strict=True)] if by_columns else matrix


def _distortion(path: Path, content: Mapping[str, Any]) -> tuple[float, ...]:
    given = next((content[key] for key in DISTORTION_KEYS if content.get(key) is not None), None)
    if isinstance(given, dict):
        given = given.get("data", [given.get(key, 0.0) for key in _names(given)])
    if given is None:
        given = [content.get(key, 0.0) for key in _names(content)]
    return tuple(_numbers(path, np.ravel(np.array(given, dtype=object)).tolist()))


def _names(content: Mapping[str, Any]) -> list[str]:
    """Names of the coefficients k1, k2, … in OpenCV's order, as far as the file has some."""
    fisheye = any(str(content.get(key, "")).lower() in FISHEYE for key in MODEL_KEYS)
    names = (
        ["k1", "k2", "k3", "k4"] if fisheye else ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]
    )
    last = max((place for place, name in enumerate(names) if name in content), default=-1)
    full = next(length for length in (0, 4, 5, 8) if last < length)
    return names[:full]


def _is_fisheye(path: Path, content: Mapping[str, Any], distortion: Sequence[float]) -> bool:
    model = next((str(content[key]) for key in MODEL_KEYS if content.get(key) is not None), "")
    name = model.lower().replace("-", "_").replace(" ", "_")
    if name in FISHEYE:
        return True
    if name not in BROWN and any(distortion):
        raise ValueError(
            f"{path}: the distortion model {model!r} is not known; expected are OpenCV's (plumb_bob, radtan, "
            "rational_polynomial) and its fisheye model (equidistant). Undistort the landmarks yourself and "
            "leave the coefficients out."
        )
    return False


def _size(content: Mapping[str, Any]) -> tuple[float, float] | None:
    pairs = [content[key] for key in SIZE_KEYS if content.get(key) is not None]
    pairs += [[content.get(width), content.get(height)] for width, height in WIDTH_HEIGHT]
    for pair in pairs:
        if isinstance(pair, dict):
            pair = [pair.get("width"), pair.get("height")]
        if isinstance(pair, list) and len(pair) == 2:
            numbers = [float(one) for one in pair if isinstance(one, int | float) and one > 0]
            if len(numbers) == 2:
                return numbers[0], numbers[1]
    return None


def _numbers(path: Path, values: Sequence[Any]) -> list[float]:
    try:
        numbers = [float(value) for value in values]
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: a camera's parameter is not a number ({error}).") from error
    if not np.isfinite(numbers).all():
        raise ValueError(f"{path}: a camera's parameter is not finite; expected numbers.")
    return numbers
