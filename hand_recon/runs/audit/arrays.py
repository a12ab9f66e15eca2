"""Hands in NumPy's files: 3D landmarks, and MANO's parameters as HaMeR, WiLoR and HaWoR name them.

Arrays alone are read. An array of objects is a pickle, which may run code, and is refused.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import Tensor

from hand_recon.data.dexycb.labels import MISSING
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.joint_orders import COUNTS, to_landmarks
from hand_recon.reading.archives import load_array, load_arrays
from hand_recon.reading.text import read_bytes
from hand_recon.runs.audit.mano import ManoReader, mano_pose

POINTS: Final = (
    "landmarks_3d", "joint_3d", "pred_keypoints_3d", "keypoints_3d", "keypoints3d", "joints_3d", "joints3d",
    "joints", "landmarks", "points", "xyz", "handJoints3D",
)  # fmt: skip
"""Names of 3D landmarks, the first that is there being read."""

POSES: Final = (
    "hand_pose",
    "pose_body",
    "init_hand_pose",
    "pred_hand_pose",
    "mano_pose",
    "handPose",
    "pose",
    "poses",
)
"""Names of MANO's pose."""

SHAPES: Final = ("betas", "init_betas", "pred_betas", "mano_shape", "handBeta", "shape")
"""Names of MANO's shape."""

ROTATIONS: Final = ("global_orient", "root_orient", "init_root_orient", "pred_global_orient", "rot")
"""Names of the rotation of the whole hand."""

RIGHT: Final = ("is_right", "right")
"""Names of the side: 1 for right hands, 0 for left ones."""


def read_npy(path: Path) -> GivenHands:
    """Landmarks of an array, hand × point × 3 or hand × coordinate.

    Args:
        path: The file.

    Raises:
        ValueError: It holds objects, or an array of another shape.
    """
    try:
        array = load_array(read_bytes(path), path)
    except ValueError as error:
        raise ValueError(_refusal(path, error)) from error
    return _of_points(path, "", array, {})


def read_npz(path: Path, mano: ManoReader | None) -> GivenHands:
    """Hands of an archive: MANO's parameters with the user's MANO, else landmarks.

    Args:
        path: The file.
        mano: The user's MANO; None without.

    Raises:
        ValueError: It holds objects, or neither landmarks nor parameters that can be read.
    """
    return of_arrays(path, _arrays(path), mano)


def of_arrays(path: Path, arrays: Mapping[str, np.ndarray], mano: ManoReader | None) -> GivenHands:
    """Hands of arrays with names: MANO's parameters with the user's MANO, else landmarks.

    Args:
        path: Their file.
        arrays: The arrays by name.
        mano: The user's MANO; None without.

    Raises:
        ValueError: There are neither landmarks nor parameters that can be read.
    """
    pose, points = _first(arrays, POSES), _first(arrays, POINTS)
    if pose is not None and mano is not None:
        return _of_pose(path, pose, arrays, mano)
    if points is None and len(arrays) == 1:
        points = next(iter(arrays))
    if points is not None and pose != points:
        return _of_points(path, points, arrays[points], arrays)
    if pose is not None:
        raise ValueError(
            f"{path} holds MANO's parameters ({pose}) and no 3D landmarks. Give hand=mano with your own MANO "
            "(data/README.md), or an npz with landmarks_3d."
        )
    raise ValueError(
        f"{path} holds {', '.join(sorted(arrays)) or 'nothing'}; expected 3D landmarks "
        f"({', '.join(POINTS[:4])}) or MANO's parameters ({', '.join(POSES[:3])})."
    )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        return load_arrays(path, path)
    except ValueError as error:
        raise ValueError(_refusal(path, error)) from error


def _refusal(path: Path, error: ValueError) -> str:
    return (
        f"{path} is empty or damaged ({error}); expected arrays of NumPy. Arrays of objects are pickles, "
        "which may run code, and are not read: save the numbers with numpy.savez, one array for each of them."
    )


def _first(arrays: Mapping[str, np.ndarray], names: tuple[str, ...]) -> str | None:
    return next((name for name in names if name in arrays), None)


def _of_points(
    path: Path, key: str, array: np.ndarray, arrays: Mapping[str, np.ndarray]
) -> GivenHands:
    """Landmarks of one array; frames of tracks, track × frame × point × 3, are sequences."""
    array = _as_points(path, key, array)
    lead = array.shape[:-2]
    points = torch.from_numpy(array.reshape(-1, *array.shape[-2:])).float()
    # DexYCB marks frames without a hand like this.
    points[(points == MISSING).flatten(1).all(dim=1)] = torch.nan
    sides = _sides(arrays, lead)
    return _tracks(
        of_points(to_landmarks(points), str(path), names=_names(lead), sides=sides), lead
    )


def _as_points(path: Path, key: str, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{path}: {key or 'the array'} holds {array.dtype}; expected numbers.")
    if array.ndim and array.shape[-1] in [3 * count for count in COUNTS]:
        array = array.reshape(*array.shape[:-1], -1, 3)
    if array.ndim == 2:
        array = array[None]
    if array.ndim < 3 or array.shape[-1] != 3 or array.shape[-2] not in COUNTS:
        raise ValueError(
            f"{path}: {key or 'the array'} has the shape {array.shape}; expected hand × 21 × 3 (or 25 or 26 "
            "joints of WebXR or OpenXR)."
        )
    return array


def _of_pose(
    path: Path, key: str, arrays: Mapping[str, np.ndarray], mano: ManoReader
) -> GivenHands:
    """Hands of MANO's parameters."""
    pose = arrays[key]
    if pose.ndim == 0 or not pose.size:
        raise ValueError(
            f"{path}: {key} has the shape {pose.shape}; expected rotations of 15 joints."
        )
    trailing = 3 if pose.shape[-2:] == (3, 3) else 2 if pose.shape[-1] == 3 else 1
    lead = pose.shape[: pose.ndim - trailing]
    if not lead:
        lead, pose = (1,), pose[None]
    count = int(np.prod(lead))

    def rows(names: tuple[str, ...], width: int) -> Tensor | None:
        name = _first(arrays, names)
        if name is None:
            return None
        values = torch.from_numpy(np.asarray(arrays[name], dtype=np.float32))
        own = width if name in ROTATIONS else values.shape[-1] if values.ndim else 1
        held = values.numel() // max(own, 1)
        # One shape for all frames of a track.
        if 0 < held < count and count % held == 0 and values.numel() == held * own and own >= width:
            values = values.reshape(held, 1, own).expand(-1, count // held, -1)
        elif values.numel() < width * count or values.numel() % count:
            raise ValueError(
                f"{path}: {name} has the shape {arrays[name].shape} and {key} is of {count} hands; expected "
                f"{width} numbers or more for each hand, or for each track."
            )
        return values.reshape(count, -1)

    flat = torch.from_numpy(np.ascontiguousarray(pose, dtype=np.float32))
    flat = flat.reshape(count, *pose.shape[pose.ndim - trailing :])
    found = mano_pose(flat, rows(SHAPES, 10), rows(ROTATIONS, 3))
    tracks = [row // lead[1] for row in range(count)] if len(lead) == 2 and lead[0] > 1 else None
    given = mano.hands(found, str(path), _sides(arrays, lead), _names(lead), tracks)
    return _tracks(given, lead)


def _names(lead: tuple[int, ...]) -> list[str]:
    """Names of hands by their place in the array: frames, or tracks and frames."""
    if len(lead) < 2:
        return [str(row) for row in range(int(np.prod(lead)))]
    return [f"{'.'.join(map(str, place))}" for place in np.ndindex(*lead)]


def _sides(arrays: Mapping[str, np.ndarray], lead: tuple[int, ...]) -> list[str]:
    count = int(np.prod(lead))
    name = _first(arrays, RIGHT)
    if name is None:
        return [""] * count
    flags = np.asarray(arrays[name], dtype=np.float64).ravel()
    if not len(flags) or count % len(flags):
        return [""] * count
    return [
        "right" if flag > 0.5 else "left" for flag in flags.repeat(count // len(flags)).tolist()
    ]


def _tracks(hands: GivenHands, lead: tuple[int, ...]) -> GivenHands:
    """Frames of several tracks as sequences; their times are numbers of frames until the rate is known."""
    if len(lead) != 2 or lead[1] < 2:
        return hands
    frames = lead[1]
    names = [f"{hands.files[0]} track {row // frames}" for row in range(len(hands))]
    times = torch.arange(len(hands)).remainder(frames).float()
    return replace(hands, sequences=tuple(names), times=times)
