"""Names of hand landmarks in the vocabularies of detectors, annotators and headsets.

Read are the names of MediaPipe (`INDEX_FINGER_MCP`), mmpose and COCO-WholeBody (`left_forefinger1`,
`right_hand_root`), WebXR and OpenXR (`index-finger-phalanx-proximal`, `XR_HAND_JOINT_INDEX_PROXIMAL_EXT`),
plain ones (`index MCP`, `leftThumbTip`) and numbers alone (0 to 20, or 1 to 21).
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from hand_recon.hand.skeleton import FINGERS, LANDMARKS

_FINGER_WORDS: Final = {
    "thumb": "thumb",
    "index": "index", "indexfinger": "index", "forefinger": "index", "fore": "index", "pointer": "index",
    "middle": "middle", "middlefinger": "middle",
    "ring": "ring", "ringfinger": "ring",
    "little": "little", "littlefinger": "little", "pinky": "little", "pinkyfinger": "little",
    "pinkie": "little",
}  # fmt: skip

_SIDE_WORDS: Final = {
    "left": "left", "l": "left", "lh": "left", "lefthand": "left",
    "right": "right", "r": "right", "rh": "right", "righthand": "right",
}  # fmt: skip

_IGNORED: Final = frozenset(
    {"hand", "finger", "joint", "xr", "ext", "phalanx", "kp", "keypoint", "landmark", "point"}
)

_PARTS: Final = {"mcp": 1, "pip": 2, "dip": 3, "tip": 4, "knuckle": 1}
"""Place of a finger's joint from its base, 1 to 4."""

_THUMB_PARTS: Final = {"cmc": 1, "tmc": 1, "mcp": 2, "ip": 3, "dip": 3, "tip": 4}

# XR names a joint after the bone that begins there; a finger's metacarpal begins at no landmark.
_XR_PARTS: Final = {"metacarpal": 0, "proximal": 1, "intermediate": 2, "distal": 3}
_XR_THUMB_PARTS: Final = {"metacarpal": 1, "proximal": 2, "distal": 3}

# A thumb whose joints are called like a finger's, which has no CMC then.
_THUMB_AS_FINGER: Final = {"mcp": 1, "pip": 2, "dip": 3, "tip": 4}


@dataclass(frozen=True)
class NamedLandmark:
    """Landmark that a name stands for."""

    landmark: int
    """Index in `hand_recon.hand.skeleton.LANDMARKS`."""
    side: str | None = None
    """`left` or `right` if the name has it."""


@dataclass(frozen=True)
class _Words:
    """A name taken apart."""

    finger: str | None
    part: str | None
    number: int | None
    side: str | None
    wrist: bool


def landmarks_of_names(names: Iterable[str]) -> dict[str, NamedLandmark]:
    """Map names to landmarks, for those that name one.

    The names of a file are read together, because its other names decide whether a finger's joints count
    from 0 or 1, and whether numbers alone do.

    Args:
        names: Names in any case, words separated by anything or by capital letters.

    >>> landmarks_of_names(["left_thumb4", "nose"])
    {'left_thumb4': NamedLandmark(landmark=4, side='left')}
    """
    taken_apart = {name: words for name in names if (words := _words(str(name))) is not None}
    lowest = _lowest_numbers(taken_apart.values())
    as_finger = _thumb_is_named_like_a_finger(taken_apart.values())
    found = {}
    for name, words in taken_apart.items():
        landmark = _landmark(words, lowest, as_finger)
        if landmark is not None:
            found[name] = NamedLandmark(landmark, words.side)
    return found


def side_in(text: object) -> str | None:
    """The side that a text has among its words, such as the name of a category; None for both or neither.

    >>> side_in("left_hand"), side_in("right-handed person's left hand"), side_in("hand")
    ('left', None, None)
    """
    spelt_out = {word: side for word, side in _SIDE_WORDS.items() if len(word) > 2}
    sides = {spelt_out[word] for word in _split(str(text)) if word in spelt_out}
    return sides.pop() if len(sides) == 1 else None


def _split(name: str) -> list[str]:
    """Words of a name in lower case: `leftThumbTip` as left, thumb, tip."""
    return [
        word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_]+", name)
    ]


def _words(name: str) -> _Words | None:
    """The parts of a name; None if it has a word that no landmark's name has."""
    finger = part = side = None
    number: int | None = None
    wrist = False
    for word in _split(name):
        if word in _FINGER_WORDS and finger is None:
            finger = _FINGER_WORDS[word]
        elif word in _SIDE_WORDS and side is None:
            side = _SIDE_WORDS[word]
        elif word in {"wrist", "root", "carpus"}:
            wrist = True
        elif word in _PARTS | _THUMB_PARTS | _XR_PARTS and part is None:
            part = word
        elif word.isascii() and word.isdigit() and len(word) < 3 and number is None:
            number = int(word)
        elif word not in _IGNORED:
            return None
    return _Words(finger, part, number, side, wrist)


def _lowest_numbers(names: Iterable[_Words]) -> Mapping[bool, int | None]:
    """The number that stands for the first landmark, for numbers of a finger (True) and alone (False).

    None where the numbers leave it open.
    """
    numbers: dict[bool, set[int]] = defaultdict(set)
    for words in names:
        if words.number is not None and words.part is None and not words.wrist:
            numbers[words.finger is not None].add(words.number)
    lowest: dict[bool, int | None] = {}
    for of_finger, found in numbers.items():
        last = 4 if of_finger else 21
        if min(found) == 0:
            lowest[of_finger] = 0
        else:
            # 1 to 20 alone may count from 0 without the wrist. A finger's joints count from 1 unless there
            # is a 0.
            lowest[of_finger] = 1 if of_finger or last in found else None
    return lowest


def _thumb_is_named_like_a_finger(names: Iterable[_Words]) -> bool:
    parts = {words.part for words in names if words.finger == "thumb"}
    return "pip" in parts and not parts & {"cmc", "tmc"}


def _landmark(
    words: _Words, lowest: Mapping[bool, int | None], thumb_as_finger: bool
) -> int | None:
    if words.finger is None:
        if words.wrist:
            return 0 if words.part is None else None
        first = lowest.get(False)
        if words.number is None or words.part is not None or first is None:
            return None
        return words.number - first if 0 <= words.number - first < len(LANDMARKS) else None
    place = _place(words, lowest, thumb_as_finger)
    return None if place is None else 4 * FINGERS.index(words.finger) + place


def _place(words: _Words, lowest: Mapping[bool, int | None], thumb_as_finger: bool) -> int | None:
    """Place of a landmark along its finger, 1 to 4."""
    if words.part is not None:
        parts = _PARTS | _XR_PARTS
        if words.finger == "thumb":
            parts = _THUMB_AS_FINGER if thumb_as_finger else _THUMB_PARTS | _XR_THUMB_PARTS
        return parts.get(words.part) or None
    if words.number is None or words.wrist:
        return None
    place = words.number - (lowest.get(True) or 0) + 1
    return place if 1 <= place <= 4 else None
