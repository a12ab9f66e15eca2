"""Parses hands in JSON: lists of points, or objects that also have side, image and camera."""

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.data.landmarks.camera_files import to_camera_matrices
from hand_recon.data.landmarks.formats.found import counts_in_words, sizes_of
from hand_recon.data.landmarks.formats.names import landmarks_of_names
from hand_recon.data.landmarks.formats.point_lists import (
    PointHand,
    PointLists,
    hands_in,
)
from hand_recon.data.landmarks.parsed import SIDES, ParsedHands, read_side
from hand_recon.data.landmarks.results_again import entries_of_results, is_result

logger = logging.getLogger(__name__)

LANDMARK_KEYS: Final = ("landmarks", "landmarks_2d")
"""Keys of an object's 21 points."""

SIDE_KEYS: Final = ("side", "handedness")
"""Keys of an object's side."""

CAMERA_KEYS: Final = ("intrinsics", "K")
"""Keys of an object's camera matrix."""

SIGMA_KEYS: Final = ("sigma_2d", "sigma")
"""Keys of an object's standard deviations."""

SIZE_KEYS: Final = ("width", "height", "image_size")
"""Keys of the image's size."""

KNOWN_KEYS: Final = (
    *LANDMARK_KEYS, *SIDE_KEYS, *CAMERA_KEYS, *SIGMA_KEYS, "image", "name", "confidence", "box", "occluded",
    *SIZE_KEYS,
)  # fmt: skip
"""All keys of an object that are read."""


def objects_in(path: Path, content: dict[str, Any]) -> list[Any]:
    """The hands of an object: itself, or its values, which its keys name by image or by side.

    Raises:
        ValueError: It is something else.
    """
    if any(key in content for key in LANDMARK_KEYS) or len(landmarks_of_names(content)) > 9:
        return [content]
    entries = []
    for key, value in (content or {"": None}).items():
        hands = hands_in(value) if isinstance(value, list) and value else []
        if not hands or any(not isinstance(hand.points, list | None) for hand in hands):
            raise ValueError(
                f"{path} is an object with the keys {sorted(content)[:10]}; expected a list of hands, an "
                "object with `landmarks`, or COCO's with `annotations`."
            )
        is_side = key.strip().lower() in SIDES
        about = {"side": key} if is_side else {"image" if Path(key).suffix else "name": key}
        entries += [{"landmarks": hand.points, **about} for hand in hands]
    return entries


def parse_points(path: Path, content: list[Any]) -> ParsedHands:
    """A list of hands of 21 points each, a list of such lists for frames, or a single hand.

    Raises:
        ValueError: A hand does not have 21 points, or a point is something else.
    """
    lists = PointLists(path)
    found = hands_in(content)
    hands = lists.split(found)
    numbers = lists.to_array(hands)
    names = [hand.name for hand in hands]
    frames = " for each frame" if any(hand.name for hand in found) else ""
    return ParsedHands(
        points=numbers[..., :2],
        third_value=numbers[..., 2],
        sides=[hand.side for hand in hands] if any(hand.side for hand in hands) else (),
        names=names if any(names) else (),
        title=_title(lists, "lists of hands" + frames) if frames or lists.converted else None,
    )


def parse_objects(path: Path, content: list[Any]) -> ParsedHands:
    """A list of objects, each with `landmarks` and any of `KNOWN_KEYS`; or with points by their names.

    Raises:
        ValueError: Something is not an object, has no landmarks, or a camera while others have none.
    """
    content = [inner for entry in content for inner in _with_landmarks(entry)]
    for position, entry in enumerate(content):
        if not isinstance(entry, dict) or not any(key in entry for key in LANDMARK_KEYS):
            raise ValueError(
                f"{path}: entry {position} is not an object with `landmarks`; expected every entry to be "
                "one, or every entry to be a list of 21 points."
            )
    if all(map(is_result, content)):
        entries, kind = entries_of_results(path, content)
        return replace(_parse(path, entries), title=f"{kind} of reconstructed hands")
    unknown = sorted({key for entry in content for key in entry} - set(KNOWN_KEYS))
    if unknown:
        logger.warning("%s: %s are not read; known are %s.", path, unknown, list(KNOWN_KEYS))
    return _parse(path, content)


def _parse(path: Path, content: list[dict[str, Any]]) -> ParsedHands:
    lists = PointLists(path)
    points = [PointHand(_first(entry, LANDMARK_KEYS)) for entry in content]
    hands = lists.split(points)
    if len(hands) != len(points) or any(hand.side for hand in hands):
        raise ValueError(
            f"{path}: an object has the keypoints of a whole body, expected the 21 of one hand; of 133, 91 "
            "to 111 are the left hand and 112 to 132 the right one, of 136, 94 to 114 and 115 to 135."
        )
    numbers = lists.to_array(hands)
    return ParsedHands(
        points=numbers[..., :2],
        third_value=numbers[..., 2],
        confidence=_values(path, content, ("confidence",)),
        sigma=_values(path, content, SIGMA_KEYS),
        intrinsics=_cameras(path, content),
        sides=[
            read_side(f"{path}: hand {position}", _first(entry, SIDE_KEYS))
            for position, entry in enumerate(content)
        ],
        names=[_text(entry.get("name")) for entry in content],
        images=[_text(entry.get("image")) for entry in content],
        boxes=_boxes(path, content),
        occluded=_occluded(path, content),
        image_sizes=sizes_of(content),
        title=_title(lists, "objects with landmarks") if lists.converted else None,
    )


def _with_landmarks(entry: object) -> list[Any]:
    """An object with named points, as one object with `landmarks` for each side among the names."""
    if not isinstance(entry, dict):
        return [entry]
    inside = _first(entry, LANDMARK_KEYS)
    if inside is not None and not isinstance(inside, dict):
        return [entry]
    named = entry if inside is None else inside
    known = landmarks_of_names(named)
    if not known or (inside is None and len(known) < 10):
        return [entry]
    others = {key: value for key, value in entry.items() if key not in (*known, *LANDMARK_KEYS)}
    return [
        {
            **others,
            **({"side": side} if side else {}),
            "landmarks": {name: named[name] for name in known if known[name].side == side},
        }
        for side in sorted({found.side for found in known.values()}, key=str)
    ]


def _title(lists: PointLists, kind: str) -> str:
    return ", ".join([kind, *counts_in_words(lists.converted)])


def _values(
    path: Path, content: list[Any], keys: tuple[str, ...]
) -> Float[np.ndarray, "hand landmark=21"] | None:
    """One number per landmark, for hands that have them; of a pair, one per coordinate, the RMS."""
    given = [_first(entry, keys) for entry in content]
    if all(values is None for values in given):
        return None
    try:
        rows = [
            [
                math.hypot(*value) / math.sqrt(2) if isinstance(value, list) else value
                for value in values or [None] * 21
            ]
            for values in given
        ]
        return np.array(rows, dtype=np.float64).reshape(len(content), 21)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{path}: `{keys[-1]}` must be a list of 21 numbers (or null) for each hand that has it."
        ) from error


def _boxes(path: Path, content: list[Any]) -> Float[np.ndarray, "hand 4"] | None:
    """The boxes of the hands that have one."""
    if not any(entry.get("box") is not None for entry in content):
        return None
    try:
        rows = [entry.get("box") or [None] * 4 for entry in content]
        return np.array(rows, dtype=np.float64).reshape(len(content), 4)
    except (ValueError, TypeError, OverflowError) as error:
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
    except (ValueError, TypeError) as error:
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
