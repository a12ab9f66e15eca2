"""MediaPipe's results: landmarks as shares of the image's size, with a handedness for each hand.

Read are the results of the hand landmarker and the gesture recogniser of MediaPipe Tasks, of Python and of
JavaScript (`landmarks` or `hand_landmarks`, and `handedness`), of the older Solutions
(`multi_hand_landmarks`, and `multi_handedness`), of the holistic landmarker (`left_hand_landmarks`,
`right_hand_landmarks`), and the hands of TensorFlow.js (`keypoints` with `handedness`, in pixels).

Since version 0.10.5 a handedness is that of the hand in the image. Before, and in Solutions, it is that of
the mirrored image. The index of the category tells which: 0 stands for the right hand since 0.10.5, and for
the left one before. MediaPipe has no confidence of a landmark; z is a depth of another scale and is not read.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.formats.found import (
    FoundHand,
    Reading,
    all_documents,
    documents,
    first_of,
    size_of,
    text_of,
)
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "MediaPipe's results"

HANDS: Final = (
    "landmarks", "hand_landmarks", "handLandmarks", "multi_hand_landmarks", "multiHandLandmarks",
)  # fmt: skip
"""Keys of a list of hands."""

SIDES: Final = {
    "left": ("left_hand_landmarks", "leftHandLandmarks"),
    "right": ("right_hand_landmarks", "rightHandLandmarks"),
}
"""Keys of one hand in holistic results."""

WORLD: Final = (
    "world_landmarks", "worldLandmarks", "hand_world_landmarks", "handWorldLandmarks",
    "multi_hand_world_landmarks", "multiHandWorldLandmarks",
)  # fmt: skip
"""Keys of hands in 3D."""

_HANDEDNESS: Final = ("handedness", "handednesses", "multi_handedness", "multiHandedness")
_SOLUTIONS: Final = ("multi_handedness", "multiHandedness")


def is_mediapipe(content: object) -> bool:
    """True for MediaPipe's results of an image, or of several in a list."""
    return all_documents(content, _is_result) and any(map(_has_points, documents(content)))


def parse_mediapipe(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all images, as shares of the image's size.

    Raises:
        ValueError: There are none, only 3D ones, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    several = isinstance(content, list)
    only_world = True
    for number, document in enumerate(documents(content)):
        frame = text_of(first_of(document, ("frame", "frame_id", "timestamp_ms", "timestamp")))
        called = f"frame {frame or number}, " if several else ""
        only_world &= any(key in document for key in WORLD) and not _has_hands(document)
        _add_result(reading, document, called)
    if only_world:
        raise ValueError(
            f"{path} holds MediaPipe's world landmarks, which are 3D points in metres and not in the image. "
            "Give the landmarks of the same result (`landmarks`, `hand_landmarks` in Python)."
        )
    return reading.parsed()


_OWN_KEYS: Final = frozenset({"side", "intrinsics", "K", "confidence", "sigma", "box"})
"""Keys of the project's own objects, which may have points with x and y, too."""


def _is_result(document: dict[str, Any]) -> bool:
    if "keypoints" in document and "handedness" in document and "annotations" not in document:
        points = document["keypoints"]
        return isinstance(points, list) and all(_is_point(point) for point in points)
    keys = (*HANDS, *WORLD, *(key for names in SIDES.values() for key in names))
    of_hands = any(key in document and _are_hands(document[key]) for key in keys)
    return of_hands and not document.keys() & _OWN_KEYS


def _has_points(document: dict[str, Any]) -> bool:
    """True for a result with a hand, or with a list of handedness, which may be empty."""
    keys = (*HANDS, *WORLD, "keypoints", *(key for names in SIDES.values() for key in names))
    given = first_of(document, _HANDEDNESS)
    return bool(first_of(document, keys)) or isinstance(given, list)


def _has_hands(document: dict[str, Any]) -> bool:
    keys = (*HANDS, "keypoints", *(key for names in SIDES.values() for key in names))
    return any(key in document for key in keys)


def _are_hands(value: object) -> bool:
    """True for lists, objects with `landmark`, or both nested, that end in objects with x and y."""
    for _ in range(4):
        if isinstance(value, dict) and "landmark" in value:
            value = value["landmark"]
        if isinstance(value, dict):
            return "x" in value and "y" in value
        if not isinstance(value, list):
            return False
        if not value:
            return True
        value = value[0]
    return False


def _add_result(reading: Reading, document: dict[str, Any], called: str) -> None:
    image = text_of(first_of(document, ("image", "file_name", "filename", "image_path")))
    size = size_of(document)
    for key_side, keys in SIDES.items():
        hand = first_of(document, keys)
        if hand:
            points = _points(reading, hand, f"{called}`{keys[0]}`")
            reading.add(FoundHand(points, key_side, f"{called}{key_side}", image, image_size=size))
    hands = first_of(document, (*HANDS, "keypoints"))
    if isinstance(hands, list) and hands and _is_point(hands[0]):
        hands = [hands]
    sides = _sides(reading, document)
    for number, hand in enumerate(reading.entries(hands, f"{called}the list of hands")):
        points = _points(reading, hand, f"{called}hand {number}")
        side = sides[number] if number < len(sides) else None
        reading.add(FoundHand(points, side, f"{called}hand {number}", image, image_size=size))


def _is_point(value: object) -> bool:
    return isinstance(value, dict) and "x" in value


def _points(reading: Reading, hand: Any, where: str) -> Float[np.ndarray, "landmark=21 2"]:  # noqa: ANN401
    if isinstance(hand, dict) and "landmark" in hand:
        hand = hand["landmark"]
    entries = reading.objects(hand, where)
    rows = [[point.get("x"), point.get("y")] for point in entries]
    return reading.numbers(rows, where, 21, 2)


def _sides(reading: Reading, document: dict[str, Any]) -> list[str | None]:
    """Side of each hand in the image as it is."""
    given = first_of(document, _HANDEDNESS)
    solutions = first_of(document, _SOLUTIONS) is not None
    if isinstance(given, str):
        given = [given]
    return [_side(entry, solutions) for entry in reading.entries(given, "the handedness")]


def _side(entry: object, solutions: bool) -> str | None:
    """Side by a handedness: a word, a category, or a list of them with the most likely one first."""
    category = _category(entry)
    labels = ("categoryName", "category_name", "label", "displayName", "display_name")
    label = str(first_of(category, labels)).lower()
    if label not in {"left", "right"}:
        return None
    mirrored = solutions
    if category.get("index") in (0, 1):
        mirrored = (category["index"] == 0) == (label == "left")
    if not mirrored:
        return label
    return "right" if label == "left" else "left"


def _category(entry: object) -> dict[str, Any]:
    """The most likely category of a handedness, with its label."""
    for _ in range(3):
        if isinstance(entry, dict) and "classification" in entry:
            entry = entry["classification"]
        if isinstance(entry, list):
            entry = entry[0] if entry else None
    if isinstance(entry, str):
        return {"label": entry}
    return entry if isinstance(entry, dict) else {}
