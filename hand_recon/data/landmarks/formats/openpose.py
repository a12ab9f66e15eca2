"""OpenPose's output for one image: people with `hand_left_keypoints_2d` and `hand_right_keypoints_2d`.

Each is a flat list of u, v and a score of 21 keypoints in FreiHAND's order (Simon et al., CVPR 2017); all
zeros, or an empty list, stand for a hand that was not found. Body, face and 3D keypoints are not read.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.formats.found import (
    NOT_FOUND,
    FoundHand,
    Reading,
    all_documents,
    documents,
    first_of,
)
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "OpenPose's people"

KEYS: Final = {
    "left": ("hand_left_keypoints_2d", "hand_left_keypoints"),
    "right": ("hand_right_keypoints_2d", "hand_right_keypoints"),
}
"""Keys of a person's hands, current ones and those of version 1.0."""


def is_openpose(content: object) -> bool:
    """True for OpenPose's output, or several of them in a list."""
    return all_documents(content, lambda document: isinstance(document.get("people"), list))


def parse_openpose(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all people, the left one first.

    Raises:
        ValueError: There are none, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    several = isinstance(content, list)
    people = without = 0
    for number, document in enumerate(documents(content)):
        frame = f"image {number}, " if several else ""
        for person, entry in enumerate(reading.objects(document["people"], f"{frame}`people`")):
            people += 1
            without += not any(first_of(entry, keys) for keys in KEYS.values())
            _add_person(reading, entry, f"{frame}person {person}")
    if people and without == people:
        raise ValueError(
            f"{path} is read as {TITLE}, and none of {people} has hands. Run OpenPose with --hand."
        )
    return reading.parsed()


def _add_person(reading: Reading, entry: dict[str, Any], called: str) -> None:
    for side, keys in KEYS.items():
        values = first_of(entry, keys)
        if not values:
            reading.left_out[NOT_FOUND] += 1
            continue
        numbers = reading.numbers(values, f"{called}, `{keys[0]}`", 63).reshape(21, 3)
        points, score = numbers[:, :2].copy(), numbers[:, 2]
        points[score <= 0] = np.nan
        reading.add(FoundHand(points, side, f"{called} {side}", confidence=score))
