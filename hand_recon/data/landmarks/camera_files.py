"""Camera matrices from a file: JSON, plain text or `.npy`, one or one per hand."""

import json
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.parsed import refuse


def read_intrinsics(path: Path, hands: int) -> Float[np.ndarray, "hand 3 3"]:
    """Camera matrices, pixels of the whole image, checked.

    Args:
        path: JSON with one 3×3 matrix or a list of them (FreiHAND's `training_K.json`), text with nine
            numbers per matrix, or `.npy`.
        hands: Number of hands; a single matrix is used for all.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It holds something else, or another number of matrices.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No camera matrices at {path}. Leave intrinsics out if the camera is unknown."
        )
    with path.open("rb") as stream:
        start = stream.read(64).lstrip()
    if start.startswith(b"\x93NUMPY"):
        matrices = np.load(path, allow_pickle=False)
    elif start.startswith((b"[", b"{")):
        matrices = _from_json(path)
    else:
        matrices = _from_text(path)
    checked = to_camera_matrices(path, matrices)
    if len(checked) not in (1, hands):
        raise ValueError(
            f"{path} holds {len(checked)} camera matrices for {hands} hands; expected one for all, or one "
            "for each in the order of the landmarks."
        )
    return np.repeat(checked, hands, axis=0) if len(checked) == 1 else checked


def to_camera_matrices(path: Path, values: object) -> Float[np.ndarray, "camera 3 3"]:
    """One 3×3 matrix or a list of them, checked.

    Args:
        path: Their file, for messages.
        values: Nested lists or an array.

    Raises:
        ValueError: They have another shape, or are not camera matrices.
    """
    try:
        matrices = np.array(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: camera matrices must be 3 × 3 numbers ({error}).") from error
    if matrices.shape == (3, 3):
        matrices = matrices[None]
    if matrices.ndim != 3 or matrices.shape[1:] != (3, 3) or not len(matrices):
        found = " × ".join(map(str, matrices.shape))
        raise ValueError(f"{path} holds {found} numbers, expected camera matrices of 3 × 3.")
    _check(path, matrices)
    return matrices


def _check(path: Path, matrices: Float[np.ndarray, "camera 3 3"]) -> None:
    refuse(path, ~np.isfinite(matrices).all(axis=(1, 2)), "camera matrices that are not finite.")
    focal = matrices[:, [0, 1], [0, 1]]
    refuse(
        path, np.any(focal <= 1, axis=-1),
        "focal lengths of a pixel or less; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels of the "
        "whole image.",
    )  # fmt: skip
    last_row = np.abs(matrices[:, 2] - np.array([0, 0, 1])).max(axis=-1) < 1e-6
    refuse(
        path, ~last_row | (np.abs(matrices[:, 1, 0]) > 1e-6),
        "matrices that are not [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] (written column by column?).",
    )  # fmt: skip


def _from_json(path: Path) -> object:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except ValueError as error:
        raise ValueError(f"{path} is not complete JSON ({error}).") from error
    if not isinstance(content, dict):
        return content
    for key in ("K", "intrinsics"):
        if key in content:
            return content[key]
    raise ValueError(
        f"{path} is an object with the keys {sorted(content)[:10]}; expected one with `K` or `intrinsics`, "
        "or the matrix alone."
    )


def _from_text(path: Path) -> Float[np.ndarray, "camera 3 3"]:
    words = [word for word in re.split(r"[\s,;]+", _text(path)) if word]
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
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is neither text nor a .npy file ({error}).") from error
