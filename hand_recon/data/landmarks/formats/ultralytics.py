"""Ultralytics' files: results of a pose model in JSON, and labels of one image in YOLO's text format.

A result has `keypoints` with lists `x`, `y` and, if wanted, `visible`, in pixels or in shares of the image's
size. A line of a label file has the class, the box (four shares) and 21 times u, v and, if wanted, a
visibility or a score, in shares; a score of the whole hand may end it. Its image is that of the same name
beside it, or in a folder `images` beside the folder `labels`.
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
    text_of,
)
from hand_recon.data.landmarks.formats.names import side_in
from hand_recon.data.landmarks.formats.whole_body import layout_of, pick
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "Ultralytics' results"
LABELS_TITLE: Final = "YOLO's labels"

_BEFORE: Final = 5
"""Numbers of a line in front of the keypoints: class and box."""

_ENDINGS: Final = (
    ".jpg",
    ".jpeg",
    ".png",
    ".JPG",
    ".JPEG",
    ".PNG",
    ".webp",
    ".bmp",
    ".tif",
    ".tiff",
)


def is_ultralytics(content: object) -> bool:
    """True for results whose keypoints are lists of x and y."""

    def has_lists(entry: dict[str, Any]) -> bool:
        keypoints = entry.get("keypoints")
        return isinstance(keypoints, dict) and "x" in keypoints and "y" in keypoints

    return all_documents(content, has_lists)


def parse_ultralytics(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all results.

    Raises:
        ValueError: There are none, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    for number, entry in enumerate(documents(content)):
        keypoints = entry["keypoints"]
        where = f"`keypoints` of result {number}"
        u = reading.numbers(keypoints["x"], where, -1)
        v = reading.numbers(keypoints["y"], where, len(u))
        given = keypoints.get("visible")
        seen = np.full(len(u), np.nan) if given is None else reading.numbers(given, where, len(u))
        image = text_of(entry.get("image", entry.get("path")))
        side = side_in(entry.get("name", ""))
        _add(
            reading,
            np.stack([u, v, seen], axis=-1),
            FoundHand(_NOTHING, side, f"result {number}", image),
        )
    return reading.parsed()


def is_yolo_labels(text: str) -> bool:
    """True for lines of as many numbers as a hand's label has."""
    words = text.lstrip().partition("\n")[0].split()
    if len(words) not in _lengths():
        return False
    return all(
        word.lower().strip("+-").replace(".", "").replace("e-", "").isdecimal() for word in words
    )


def parse_yolo_labels(path: Path, text: str) -> ParsedHands:
    """The hands of one image, in shares of its size.

    Raises:
        ValueError: A line has another number of numbers, or words.
    """
    reading = Reading(path, LABELS_TITLE)
    image = _image_of(path)
    for number, line in enumerate(filter(str.strip, text.splitlines()), start=1):
        words = line.split()
        if len(words) not in _lengths():
            raise reading.error(f"line {number}", line, "5 numbers and 21 keypoints of 2 or 3")
        per_point = 3 if len(words) >= _BEFORE + 63 else 2
        numbers = reading.numbers(words, f"line {number}", len(words))
        points = numbers[_BEFORE : _BEFORE + 21 * per_point].reshape(21, per_point)
        points = np.pad(points, ((0, 0), (0, 3 - per_point)), constant_values=np.nan)
        _add(reading, points, FoundHand(_NOTHING, None, f"{path.stem} line {number}", image))
    return reading.parsed()


_NOTHING: Final = np.full((21, 2), np.nan)


def _lengths() -> set[int]:
    """Numbers of a line: with 2 or 3 per keypoint, without and with a score of the hand."""
    return {_BEFORE + 21 * per_point + score for per_point in (2, 3) for score in (0, 1)}


def _add(reading: Reading, keypoints: Float[np.ndarray, "keypoint 3"], about: FoundHand) -> None:
    """Add the hands among keypoints of u, v and visibility or score."""
    layout = layout_of(len(keypoints))
    if layout is None:
        reading.left_out[f"bodies of {len(keypoints)} keypoints"] += 1
        return
    for side, places in layout.hands.items():
        hand = pick(keypoints, places)
        points, seen = hand[:, :2].copy(), hand[:, 2]
        points[seen == 0] = np.nan
        # Labels have COCO's visibility, which says nothing about precision.
        are_scores = bool((~np.isin(seen, (0, 1, 2)) & ~np.isnan(seen)).any())
        called = " ".join(word for word in (about.name, side) if word)
        score = seen if are_scores else None
        reading.add(FoundHand(points, side or about.side, called, about.image, score))


def _image_of(path: Path) -> str | None:
    """The image of a label file, if it is there."""
    folders = [path.parent]
    if path.parent.name == "labels":
        folders.append(path.parent.parent / "images")
    elif path.parent.parent.name == "labels":
        folders.append(path.parent.parent.parent / "images" / path.parent.name)
    beside = [folder / f"{path.stem}{ending}" for folder in folders for ending in _ENDINGS]
    found = next((image for image in beside if image.is_file()), None)
    return None if found is None else str(found.absolute())
