"""Hands in JSON and text: 3D landmarks of datasets, of predictions and of headsets."""

from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.fitting.hand_entry import KEYS
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.joint_orders import COUNTS, to_landmarks
from hand_recon.protocols.benchmarks import protocol_named
from hand_recon.protocols.prediction_files import read_predictions
from hand_recon.reading.text import parse_json, read_text
from hand_recon.runs.audit.arrays import POSES, of_arrays
from hand_recon.runs.audit.mano import ManoReader, mano_pose

HEAD: Final = 1 << 14
"""Characters by which a JSON file is told apart."""

POINTS: Final = (
    "jointPositions",
    "landmarks_3d",
    "joints",
    "landmarks",
    "points",
    "keypoints_3d",
    "xyz",
)
"""Names of the points of one recorded hand."""

SIDES: Final = ("handedness", "side", "hand")
"""Names of its side."""

_MANO_NUMBERS: Final = 61


def holds_hands(path: Path) -> bool:
    """True if a JSON file is a file of hands: its first object has that file's keys."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        head = stream.read(HEAD)
    if head.strip() == "[]":
        return True
    return all(f'"{key}"' in head for key in ("landmarks_3d", "joint_angles_degrees", KEYS[4]))


def read_json(path: Path, mano: ManoReader | None) -> GivenHands:
    """Landmarks of a JSON file: lists of points, predictions of a benchmark, or recorded hands.

    Args:
        path: The file, or a zip of predictions.
        mano: The user's MANO, for FreiHAND's MANO labels; None without.

    Raises:
        ValueError: The file holds something else.
    """
    if path.suffix.lower() == ".zip":
        return _predictions(path)
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        head = "".join(stream.read(HEAD).split())
    if head.startswith("[["):
        return _lists(path, head, mano)
    try:
        content = parse_json(read_text(path), path)
    except ValueError as error:
        raise ValueError(
            f"{path} is not JSON ({error.__cause__ or error}); expected hands. Write the file again."
        ) from error
    if isinstance(content, dict) and any(name in content for name in POSES):
        return of_arrays(path, _named_arrays(path, content), mano)
    rows = content if isinstance(content, list) else [content]
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise ValueError(
            f"{path} holds a JSON {type(content).__name__} without hands; expected a list of hands, each "
            f"with one of {', '.join(POINTS)}."
        )
    return _recorded(path, rows)


def _named_arrays(path: Path, content: dict[str, Any]) -> dict[str, np.ndarray]:
    """Arrays of a JSON object, such as HaWoR's hands of a chunk of frames."""
    try:
        return {name: np.array(values, dtype=np.float64) for name, values in content.items()}
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{path} holds MANO's parameters and something else than arrays of numbers ({error}); expected "
            "rotations of 15 joints for every frame."
        ) from error


def _lists(path: Path, head: str, mano: ManoReader | None) -> GivenHands:
    """Lists of numbers: FreiHAND's MANO labels, one hand, joints of a headset, or a benchmark's landmarks."""
    depth = len(head) - len(head.lstrip("["))
    first = head[depth:].partition("]")[0].count(",") + 1
    if first == _MANO_NUMBERS:
        return _freihand_mano(path, mano)
    points = head[depth:].partition("]]")[0].count("],[") + 1
    one = depth == 2 and first == 3 and points in COUNTS
    if one or (depth == 3 and points in COUNTS[1:]):
        found = _points(path, parse_json(read_text(path), path))
        return of_points(found.reshape(-1, 21, 3), str(path))
    return _predictions(path)


def _predictions(path: Path) -> GivenHands:
    # All protocols in JSON share one form, and differ in order and unit, which are recognised.
    found = read_predictions(path, protocol_named("freihand"))
    return of_points(found.points.landmarks, str(path))


def read_lines(path: Path) -> GivenHands:
    """Landmarks of DexYCB's text, a line of an id and 63 numbers per hand.

    Args:
        path: The file.

    Raises:
        ValueError: The file has other lines.
    """
    found = read_predictions(path, protocol_named("dexycb"))
    names = [str(number) for number in found.ids.tolist()]
    return of_points(found.points.landmarks, str(path), names=names)


def _freihand_mano(path: Path, mano: ManoReader | None) -> GivenHands:
    if mano is None:
        raise ValueError(
            f"{path} holds MANO's parameters. Give hand=mano with your own MANO (data/README.md), or the "
            "training_xyz.json beside it."
        )
    try:
        labels = torch.tensor(parse_json(read_text(path), path)).reshape(-1, _MANO_NUMBERS)
    except (TypeError, RuntimeError) as error:
        raise ValueError(
            f"{path} holds something else than {_MANO_NUMBERS} numbers of MANO for every hand ({error})."
        ) from error
    rotation, residual, shape = labels[:, :3], labels[:, 3:48], labels[:, 48:58]
    found = mano_pose(mano.from_mean(residual), shape, rotation)
    sides = ["right"] * len(labels)
    return mano.hands(found, str(path), sides, [str(row) for row in range(len(labels))])


def _recorded(path: Path, rows: list[dict[str, Any]]) -> GivenHands:
    """Hands as objects, each with its points."""
    points, names, sides = [], [], []
    for number, row in enumerate(rows):
        key = next((key for key in POINTS if key in row), None)
        if key is None:
            raise ValueError(
                f"{path}, hand {number} has the keys {', '.join(map(str, list(row)[:8]))}; expected one of "
                f"{', '.join(POINTS)} with 21, 25 or 26 points."
            )
        if row[key] is None:
            found = torch.full((1, 21, 3), torch.nan, dtype=torch.float64)
        else:
            # Several frames of one hand are several hands.
            found = _points(path, row[key]).reshape(-1, 21, 3)
        points.append(found)
        sides += [_side(row)] * len(found)
        name = _name(row, number)
        names += [name] if len(found) == 1 else [f"{name}.{frame}" for frame in range(len(found))]
    known = [None if not side else side == "left" for side in sides]
    return of_points(torch.cat(points), str(path), names=names, left=known, sides=sides)


def _side(row: dict[str, Any]) -> str:
    """Side of a recorded hand; empty if it is not told."""
    side = str(next((row[name] for name in SIDES if row.get(name)), "")).lower()
    return {"l": "left", "left": "left", "r": "right", "right": "right"}.get(side, "")


def _name(row: dict[str, Any], number: int) -> str:
    """Name of a recorded hand."""
    name = row.get("name", row.get("names"))
    if isinstance(name, list):
        name = name[0] if name else None
    return str(number) if name is None else str(name)


def _points(path: Path, values: object) -> Float[Tensor, "... landmark=21 3"]:
    """Points as 21 landmarks; null is missing."""
    if isinstance(values, list) and any(isinstance(one, list) for one in values):
        first = next(one for one in values if isinstance(one, list))
        if len(first) == 2:
            raise ValueError(
                f"{path} holds points of two numbers, 2D landmarks; expected 3D ones. Fit them first: "
                f"hand-recon fit {path}, and audit the hands.json that it writes."
            )
        values = [[None] * len(first) if one is None else one for one in values]
    if isinstance(values, list) and any(isinstance(one, dict) for one in values):
        raise ValueError(
            f"{path} holds points that are objects; expected a list of three numbers for each, such as "
            "[x, y, z]. MediaPipe's worldLandmarks are 3D points; its landmarks are 2D, and are to be fitted."
        )
    try:
        array = np.array(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{path}: points of different numbers, or something else than numbers ({error}); expected 21, 25 "
            "or 26 points of three numbers for every hand."
        ) from error
    if array.ndim < 2 or array.shape[-1] != 3:
        raise ValueError(f"{path}: points of the shape {array.shape}; expected point × 3.")
    return to_landmarks(torch.from_numpy(array))
