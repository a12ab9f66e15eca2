"""Parses hands in JSON: lists of points, or objects that also have side, image and camera."""

import logging
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.camera_files import to_camera_matrices
from hand_recon.data.landmarks.parsed import ParsedHands, read_side

logger = logging.getLogger(__name__)

LANDMARK_KEYS: Final = ("landmarks", "landmarks_2d")
"""Keys of an object's 21 points."""

SIDE_KEYS: Final = ("side", "handedness")
"""Keys of an object's side."""

CAMERA_KEYS: Final = ("intrinsics", "K")
"""Keys of an object's camera matrix."""

KNOWN_KEYS: Final = (
    *LANDMARK_KEYS, *SIDE_KEYS, *CAMERA_KEYS, "image", "name", "confidence", "sigma", "box", "occluded",
)  # fmt: skip
"""All keys of an object that are read."""


def parse_points(path: Path, content: list[Any]) -> ParsedHands:
    """A list of hands of 21 points each, or a single hand.

    Raises:
        ValueError: A hand does not have 21 points, or a point is something else.
    """
    hands = [content] if _is_one_hand(content) else content
    numbers = _to_array(path, hands)
    return ParsedHands(points=numbers[..., :2], third_value=numbers[..., 2])


def parse_objects(path: Path, content: list[Any]) -> ParsedHands:
    """A list of objects, each with `landmarks` and any of `KNOWN_KEYS`.

    Raises:
        ValueError: Something is not an object, has no landmarks, or a camera while others have none.
    """
    for position, entry in enumerate(content):
        if not isinstance(entry, dict) or not any(key in entry for key in LANDMARK_KEYS):
            raise ValueError(
                f"{path}: entry {position} is not an object with `landmarks`; expected every entry to be "
                "one, or every entry to be a list of 21 points."
            )
    unknown = sorted({key for entry in content for key in entry} - set(KNOWN_KEYS))
    if unknown:
        logger.warning("%s: %s are not read; known are %s.", path, unknown, list(KNOWN_KEYS))
    numbers = _to_array(path, [_first(entry, LANDMARK_KEYS) for entry in content])
    return ParsedHands(
        points=numbers[..., :2],
        third_value=numbers[..., 2],
        confidence=_values(path, content, "confidence"),
        sigma=_values(path, content, "sigma"),
        intrinsics=_cameras(path, content),
        sides=[
            read_side(f"{path}: hand {position}", _first(entry, SIDE_KEYS))
            for position, entry in enumerate(content)
        ],
        names=[_text(entry.get("name")) for entry in content],
        images=[_text(entry.get("image")) for entry in content],
        boxes=_boxes(path, content),
        occluded=_occluded(path, content),
    )


def _is_one_hand(content: list[Any]) -> bool:
    """True if the entries are points: two or three numbers each, and not all of them missing."""
    points = [entry for entry in content if entry is not None]
    return bool(points) and all(
        isinstance(point, list)
        and len(point) in (2, 3)
        and all(number is None or isinstance(number, int | float) for number in point)
        for point in points
    )


def _to_array(path: Path, hands: list[Any]) -> Float[np.ndarray, "hand landmark=21 3"]:
    """All points with their third value, NaN where something is missing."""
    try:
        array = np.array(hands, dtype=np.float64)
    except (ValueError, TypeError):
        array = np.empty(0)
    if array.ndim == 3 and array.shape[1] == 21 and array.shape[2] in (2, 3):
        missing = np.full((len(array), 21, 3 - array.shape[2]), np.nan)
        return np.concatenate([array, missing], axis=-1)
    # A missing landmark, or a third value that some lack, makes the list ragged.
    rows = [row for position, hand in enumerate(hands) for row in _rows(path, position, hand)]
    try:
        return np.array(rows, dtype=np.float64).reshape(len(hands), 21, 3)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: a coordinate is not a number ({error}).") from error


def _rows(path: Path, position: int, hand: object) -> list[list[Any]]:
    """One hand's points as three entries each; `null` is a hand that was not found."""
    if hand is None:
        return [[None] * 3] * 21
    if not isinstance(hand, list) or len(hand) != 21:
        found = f"{len(hand)} points" if isinstance(hand, list) else f"{hand!r:.40}"
        raise ValueError(
            f"{path}: hand {position} (counted from 0) has {found}, expected 21 in FreiHAND's order; write "
            "null for a landmark that is missing."
        )
    rows = []
    for landmark, point in enumerate(hand):
        if point is None:
            rows.append([None] * 3)
        elif isinstance(point, list) and len(point) in (2, 3):
            rows.append(point if len(point) == 3 else [*point, None])
        else:
            raise ValueError(
                f"{path}: landmark {landmark} of hand {position} is {point!r:.60}, expected [u, v], "
                "[u, v, confidence or sigma] or null."
            )
    return rows


def _values(
    path: Path, content: list[Any], key: str
) -> Float[np.ndarray, "hand landmark=21"] | None:
    """One number per landmark, for hands that have them; of a pair, one per coordinate, the RMS."""
    if not any(entry.get(key) is not None for entry in content):
        return None
    try:
        rows = [
            [
                math.hypot(*value) / math.sqrt(2) if isinstance(value, list) else value
                for value in entry.get(key) or [None] * 21
            ]
            for entry in content
        ]
        return np.array(rows, dtype=np.float64).reshape(len(content), 21)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{path}: `{key}` must be a list of 21 numbers (or null) for each hand that has it."
        ) from error


def _boxes(path: Path, content: list[Any]) -> Float[np.ndarray, "hand 4"] | None:
    """The boxes of the hands that have one."""
    if not any(entry.get("box") is not None for entry in content):
        return None
    try:
        rows = [entry.get("box") or [None] * 4 for entry in content]
        return np.array(rows, dtype=np.float64).reshape(len(content), 4)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{path}: `box` must be left, top, right and bottom in pixels for each hand that has it."
        ) from error


def _occluded(path: Path, content: list[Any]) -> Bool[np.ndarray, "hand landmark=21"] | None:
    """True for occluded landmarks; None unless every hand has the key."""
    known = sum(entry.get("occluded") is not None for entry in content)
    if not known:
        return None
    try:
        rows = np.array([entry.get("occluded") or [False] * 21 for entry in content], dtype=bool)
        rows = rows.reshape(len(content), 21)
    except ValueError as error:
        raise ValueError(
            f"{path}: `occluded` must be a list of 21 true or false for each hand that has it."
        ) from error
    if known < len(content):
        logger.warning(
            "%s: %d of %d hands have `occluded`; it is used only where all have it.",
            path, known, len(content),
        )  # fmt: skip
        return None
    return rows


def _cameras(path: Path, content: list[Any]) -> Float[np.ndarray, "hand 3 3"] | None:
    cameras = [_first(entry, CAMERA_KEYS) for entry in content]
    known = sum(camera is not None for camera in cameras)
    if not known:
        return None
    if known < len(cameras):
        lacking = next(position for position, camera in enumerate(cameras) if camera is None)
        raise ValueError(
            f"{path}: {known} of {len(cameras)} hands have a camera matrix, hand {lacking} has none. Give "
            "all of them one, or fit those without in a file of their own."
        )
    return to_camera_matrices(path, cameras)


def _first(entry: dict[str, Any], keys: tuple[str, ...]) -> Any:  # noqa: ANN401  # any JSON
    return next((entry[key] for key in keys if entry.get(key) is not None), None)


def _text(value: object) -> str | None:
    return None if value is None else str(value)
