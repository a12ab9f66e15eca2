"""Points of hands as nested lists: of one hand, of hands, or of frames of hands.

Besides 21 points in FreiHAND's order, a hand may be OpenXR's 26 or WebXR's 25 joints in the image, and an
entry the 133 or 136 keypoints of a body, which has two hands. A point is `[u, v]`, `[u, v, third value]`,
an object with `x` and `y`, or `null`; a hand may be an object of named points.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.landmarks.formats.names import landmarks_of_names
from hand_recon.data.landmarks.formats.whole_body import (
    HANDS_OF,
    OPENXR,
    WEBXR,
    XR_JOINTS,
    XR_NAMES,
    is_xr_hand,
)

_METRES: Final = 10.0
"""Largest coordinate of a headset's joints, metres; an image's pixels exceed it."""

_SCORES: Final = ("score", "confidence", "likelihood")
_HORIZONTAL: Final = ("x", "u")
_VERTICAL: Final = ("y", "v")

Point = Sequence[Any] | None


@dataclass(frozen=True)
class PointHand:
    """A hand as a file has it."""

    points: Any
    """List of points; None for a hand that was not found."""
    name: str | None = None
    """Its place in the file, where that is more than a number."""
    side: str | None = None
    """Side, where the place among a body's keypoints tells it."""


def is_point(value: object) -> bool:
    """True for two or three numbers, or an object with coordinates."""
    if isinstance(value, dict):
        return any(key in value for key in _HORIZONTAL)
    return (
        isinstance(value, list)
        and len(value) in (2, 3)
        and all(number is None or isinstance(number, int | float) for number in value)
    )


def hands_in(content: list[Any]) -> list[PointHand]:
    """The hands of a list: the list itself is one, has hands, or has frames of hands."""
    if _is_hand(content):
        return [PointHand(content)]
    if not any(_is_frame(entry) for entry in content):
        return [PointHand(entry) for entry in content]
    return list(_hands_of_frames(content))


def _is_hand(value: object) -> bool:
    """True if the entries are points, and not all of them missing."""
    if not isinstance(value, list):
        return False
    points = [entry for entry in value if entry is not None]
    return bool(points) and all(is_point(point) for point in points)


def _is_frame(value: object) -> bool:
    """True for a list of hands, by the first one that was found."""
    first = (
        next((hand for hand in value if hand is not None), None)
        if isinstance(value, list)
        else None
    )
    return _is_hand(first)


def _hands_of_frames(frames: list[Any]) -> Iterator[PointHand]:
    for number, frame in enumerate(frames):
        if not isinstance(frame, list):
            # What is no frame is reported as no hand, by its place.
            yield PointHand(frame, f"frame {number}")
            continue
        for position, hand in enumerate(frame):
            yield PointHand(hand, f"frame {number}, hand {position}")


class PointLists:
    """Points of a file's hands as numbers, with a count of what they were converted from."""

    def __init__(self, path: Path) -> None:
        """Start with nothing converted.

        Args:
            path: The file, for messages.
        """
        self.path = path
        self.converted: Counter[str] = Counter()

    def split(self, hands: Sequence[PointHand]) -> list[PointHand]:
        """Replace bodies by their two hands and a headset's joints by 21 of them.

        Raises:
            ValueError: Joints are in metres, or are not a headset's.
        """
        return [part for number, hand in enumerate(hands) for part in self._parts(number, hand)]

    def to_array(self, hands: Sequence[PointHand]) -> Float[np.ndarray, "hand landmark=21 3"]:
        """All points with their third value, NaN where something is missing.

        Raises:
            ValueError: A hand does not have 21 points, or a point is something else.
        """
        lists = [hand.points for hand in hands]
        try:
            array = np.array(lists, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):
            array = np.empty(0)
        if array.ndim == 3 and array.shape[1] == 21 and array.shape[2] in (2, 3):
            missing = np.full((len(array), 21, 3 - array.shape[2]), np.nan)
            return np.concatenate([array, missing], axis=-1)
        # A missing landmark, or a third value that some lack, makes the list ragged.
        rows = [row for number, hand in enumerate(lists) for row in self._rows(number, hand)]
        try:
            return np.array(rows, dtype=np.float64).reshape(len(lists), 21, 3)
        except (ValueError, TypeError, OverflowError) as error:
            raise ValueError(
                f"{self.path}: a coordinate is not a number ({error!s:.80})."
            ) from error

    def _parts(self, number: int, hand: PointHand) -> list[PointHand]:
        points = hand.points
        count = len(points) if isinstance(points, list) else 21
        if count in HANDS_OF and count != 21:
            self.converted[f"bodies of {count} keypoints"] += 1
            called = hand.name or str(number)
            return [
                PointHand([points[place] for place in places], f"{called} {side}", side)
                for side, places in HANDS_OF[count].items()
                if any(_is_there(points[place]) for place in places)
            ]
        if count in XR_JOINTS and _is_hand(points):
            self._check_joints(number, points)
            self.converted[f"hands of {XR_NAMES[count]}"] += 1
            return [PointHand([points[joint] for joint in XR_JOINTS[count]], hand.name, hand.side)]
        return [hand]

    def _check_joints(self, number: int, points: Sequence[Any]) -> None:
        """Refuse a headset's joints in 3D, and 25 or 26 points that are something else."""
        rows = [coordinates_of(point)[:2] or [None, None] for point in points]
        try:
            plane = np.array(rows, dtype=np.float64)
        except (ValueError, TypeError, OverflowError) as error:
            raise ValueError(
                f"{self.path}: a coordinate is not a number ({error!s:.80})."
            ) from error
        keep = list(XR_JOINTS[len(points)])
        if np.isnan(plane).all() or np.nanmax(np.abs(plane)) < _METRES:
            raise ValueError(
                f"{self.path}: hand {number} (counted from 0) has {len(points)} joints in metres, which are "
                f"3D points as {XR_NAMES[len(points)]} are. Project them into the image with the camera, "
                f"and give the pixels; of the joints, {keep} are the 21 landmarks."
            )
        if not is_xr_hand(plane):
            raise ValueError(
                f"{self.path}: hand {number} (counted from 0) has {len(points)} points, expected 21 in "
                f"FreiHAND's order. They are not {XR_NAMES[len(points)]} in their order, of which the joints "
                f"{keep} would be the 21 landmarks: the first 21 points lie more like a hand. Keep 21 points."
            )

    def _rows(self, position: int, hand: object) -> list[list[Any]]:
        """One hand's points as three entries each; `null` is a hand that was not found."""
        if hand is None:
            return [[None] * 3] * 21
        if isinstance(hand, dict):
            hand = self._named(position, hand)
        if not isinstance(hand, list) or len(hand) != 21:
            raise ValueError(
                f"{self.path}: hand {position} (counted from 0) has {_found(hand)}, expected 21 in "
                f"FreiHAND's order; write null for a landmark that is missing. {_cure(hand)}"
            )
        return [self._row(position, landmark, point) for landmark, point in enumerate(hand)]

    def _row(self, position: int, landmark: int, point: object) -> list[Any]:
        if point is None:
            return [None] * 3
        if isinstance(point, dict) and is_point(point):
            point = coordinates_of(point)
        if isinstance(point, list) and len(point) in (2, 3):
            return point if len(point) == 3 else [*point, None]
        raise ValueError(
            f"{self.path}: landmark {landmark} of hand {position} is {point!r:.60}, expected [u, v], "
            "[u, v, confidence or sigma] or null."
        )

    def _named(self, position: int, hand: Mapping[str, Any]) -> list[Any]:
        """A hand's points by the names of landmarks."""
        known = landmarks_of_names(hand)
        points: list[Any] = [None] * 21
        for name, landmark in known.items():
            points[landmark.landmark] = hand[name]
        if not known:
            raise ValueError(
                f"{self.path}: hand {position} (counted from 0) is an object with the keys "
                f"{sorted(hand)[:10]}, which name no landmarks; expected 21 points, or names such as "
                "`wrist`, `thumb CMC`, `index MCP`, `index tip`."
            )
        self.converted["hands of named points"] += 1
        return points


def coordinates_of(point: object) -> list[Any]:
    """Numbers of a point as a list; of an object, its coordinates and score, but not its depth."""
    if isinstance(point, list):
        return point
    if not isinstance(point, dict):
        return []

    def first(keys: Sequence[str]) -> Any:  # noqa: ANN401  # any JSON
        return next((point[key] for key in keys if point.get(key) is not None), None)

    return [first(_HORIZONTAL), first(_VERTICAL), first(_SCORES)]


def _is_there(point: object) -> bool:
    """False for a missing point: null, or zeros with or without a score of zero."""
    if isinstance(point, list):
        return any(point) and not (len(point) == 3 and point[2] == 0)
    return point is not None


def _found(hand: object) -> str:
    return f"{len(hand)} points" if isinstance(hand, list) else f"{hand!r:.40}"


def _cure(hand: object) -> str:
    """Advice for some numbers of points."""
    count = len(hand) if isinstance(hand, list) else 0
    advice = {
        17: "COCO's 17 keypoints of a body have no hands.",
        18: "OpenPose's 18 keypoints of a body have no hands.",
        20: "If the wrist is missing, write null for it in front.",
        24: "Of Oculus's 24 bones, keep the 21 landmarks and bring them into FreiHAND's order.",
        42: "Give two hands as two lists of 21.",
        63: "Write the 21 points as [u, v, third value] each.",
    }
    return advice.get(count, "") or (
        f"Of OpenXR's 26 joints, {list(OPENXR)} are the landmarks, of WebXR's 25, {list(WEBXR)}."
        if count in {25, 26}
        else ""
    )
