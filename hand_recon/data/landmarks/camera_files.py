"""Camera matrices from a file: JSON, YAML, XML, plain text or `.npy`, one or one per hand."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.camera_checks import are_shares
from hand_recon.data.landmarks.camera_formats import (
    CameraEntry,
    entries_of_colmap,
    entries_of_json,
    entries_of_yaml,
    is_colmap,
)
from hand_recon.data.landmarks.camera_xml import entries_of_xml
from hand_recon.data.landmarks.refusal import refuse
from hand_recon.reading.archives import load_array
from hand_recon.reading.naming import naming
from hand_recon.reading.text import read_bytes, read_text


@dataclass(frozen=True)
class CameraFile:
    """Cameras of a file: one for all hands, or one for each."""

    matrices: Float[np.ndarray, "camera 3 3"]
    """Camera matrices; pixels, or shares of the image's size (`camera_checks.in_pixels`)."""
    distortion: tuple[tuple[float, ...], ...]
    """Coefficients of each camera; empty where there is no distortion."""
    fisheye: tuple[bool, ...]
    """True for coefficients of OpenCV's fisheye model."""
    image_sizes: Float[np.ndarray, "camera 2"]
    """Width and height of the image that each matrix is for, pixels; NaN where unknown."""


def read_camera_file(path: Path, hands: int | None) -> CameraFile:
    """Cameras with lens distortion and image size, checked.

    Args:
        path: JSON with one 3×3 matrix or a list of them (FreiHAND's `training_K.json`), or with further keys
            (`hand_recon.data.landmarks.camera_formats`); YAML or XML of OpenCV, ROS or Kalibr; COLMAP's
            `cameras.txt`; text with nine numbers per matrix; or `.npy`.
        hands: Number of hands; a single camera is used for all. None for any number of cameras.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It holds something else, or another number of cameras.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No camera matrices at {path}. Leave intrinsics out if the camera is unknown."
        )
    with naming(path, "camera matrices"):
        entries = _entries(path)
        cameras = [to_camera_matrices(path, entry.matrix) for entry in entries]
    count = sum(map(len, cameras))
    if hands is not None and count not in (1, hands):
        raise ValueError(
            f"{path} holds {count} camera matrices for {hands} hands; expected one for all, or one for "
            "each in the order of the landmarks."
        )
    each = [entry for entry, some in zip(entries, cameras, strict=True) for _ in some]
    return CameraFile(
        matrices=np.concatenate(cameras),
        distortion=tuple(entry.distortion if any(entry.distortion) else () for entry in each),
        # Fisheye cameras whose coefficients are 0 bend rays still.
        fisheye=tuple(entry.fisheye for entry in each),
        image_sizes=np.array([entry.size or (np.nan, np.nan) for entry in each], dtype=np.float64),
    )


def to_camera_matrices(path: Path, values: object) -> Float[np.ndarray, "camera 3 3"]:
    """One 3×3 matrix or a list of them, checked.

    Matrices of 4×4, or of 3×4 without translation, give their first three rows and columns.

    Args:
        path: Their file, for messages.
        values: What the file holds.

    Raises:
        ValueError: They are no camera matrices.
    """
    try:
        matrices = np.array(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: camera matrices must be 3 × 3 numbers ({error}).") from error
    if matrices.shape in ((3, 3), (3, 4), (4, 4)):
        matrices = matrices[None]
    if matrices.ndim == 3 and matrices.shape[1:] in ((3, 4), (4, 4)):
        matrices = _without_fourth(path, matrices)
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3) or not len(matrices):
        found = " × ".join(map(str, matrices.shape))
        raise ValueError(f"{path} holds {found} numbers, expected camera matrices of 3 × 3.")
    _check(path, matrices)
    return matrices


def _without_fourth(
    path: Path, matrices: Float[np.ndarray, "camera rows 4"]
) -> Float[np.ndarray, "camera 3 3"]:
    refuse(
        path, np.abs(matrices[:, :3, 3]).max(axis=1) > 1e-9,
        "projection matrices with a translation, which are a camera matrix times a pose, K [R | t]; expected "
        "K alone, 3 × 3.",
    )  # fmt: skip
    return matrices[:, :3, :3]


def _check(path: Path, matrices: Float[np.ndarray, "camera 3 3"]) -> None:
    refuse(path, ~np.isfinite(matrices).all(axis=(1, 2)), "camera matrices that are not finite.")
    focal = matrices[:, [0, 1], [0, 1]]
    refuse(
        path, np.any(focal <= 1, axis=-1) & ~are_shares(matrices),
        "focal lengths of a pixel or less; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels of the "
        "whole image.",
    )  # fmt: skip
    last_row = np.abs(matrices[:, 2] - np.array([0, 0, 1])).max(axis=-1) < 1e-6
    refuse(
        path, ~last_row | (np.abs(matrices[:, 1, 0]) > 1e-6),
        "matrices that are not [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] (written column by column?).",
    )  # fmt: skip


def _entries(path: Path) -> list[CameraEntry]:
    with path.open("rb") as stream:
        start = stream.read(64).removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"\x93NUMPY"):
        return [CameraEntry(_array(path))]
    text = _text(path)
    if start.startswith((b"[", b"{")):
        return entries_of_json(path, text)
    if start.startswith(b"<"):
        return entries_of_xml(path, text)
    if is_colmap(text):
        return entries_of_colmap(path, text)
    if start.startswith((b"%YAML", b"---")) or re.search(r"^\s*\w+:(\s|$)", text, re.MULTILINE):
        return entries_of_yaml(path, text)
    return [CameraEntry(_from_text(path, text))]


def _array(path: Path) -> np.ndarray:
    return load_array(read_bytes(path), path)


def _from_text(path: Path, text: str) -> Float[np.ndarray, "camera 3 3"]:
    words = [word for word in re.split(r"[\s,;]+", text) if word]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError as error:
        raise ValueError(
            f"{path} is not a text of numbers ({error}); expected nine per camera matrix, row by row."
        ) from error
    if not len(numbers) or len(numbers) % 9:
        raise ValueError(f"{path} holds {len(numbers)} numbers, expected nine per camera matrix.")
    return numbers.reshape(-1, 3, 3)


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except ValueError as error:
        if not isinstance(error.__cause__, UnicodeDecodeError):
            raise
        raise ValueError(f"{path} is neither text nor a .npy file ({error.__cause__}).") from error
