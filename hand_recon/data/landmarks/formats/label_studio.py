"""Label Studio's JSON export: tasks with keypoints in percent of the image's original size.

Read are the full export (`annotations` with `result`) and JSON-MIN. A keypoint's label names its landmark.
Keypoints of one parent (`parentID`) are one hand.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, unquote, urlsplit

from hand_recon.data.landmarks.formats.found import (
    Reading,
    all_documents,
    documents,
    first_of,
    size_of,
)
from hand_recon.data.landmarks.formats.labels import LabelledImage, LabelledPoint, add_labelled
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "Label Studio's keypoints"

_CURE: Final = (
    "Put `left` and `right` into the labels, or give the keypoints of each hand a parent region."
)
_RESULTS: Final = ("annotations", "completions", "predictions")


def is_label_studio(content: object) -> bool:
    """True for an export of tasks, full or JSON-MIN."""
    return all_documents(content, lambda task: _has_results(task) or bool(_short_results(task)))


def parse_label_studio(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all tasks; of several annotations of a task, the first.

    Raises:
        ValueError: There are none, labels name no landmarks, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    images = []
    for number, task in enumerate(documents(content)):
        called = f"task {task.get('id', number)}"
        results = reading.objects(_results(reading, task, called), f"the results of {called}")
        points, size = [], None
        for region in results:
            point = _labelled(reading, region, called)
            if point is not None:
                points.append(point)
                size = size or _size(region)
        image = _image(task)
        images.append(LabelledImage(points, image or called, image, size))
    add_labelled(reading, images, _CURE)
    return reading.parsed()


def _has_results(task: dict[str, Any]) -> bool:
    return any(
        isinstance(entry, dict) and isinstance(entry.get("result"), list)
        for key in _RESULTS
        if isinstance(task.get(key), list)
        for entry in task[key]
    )


def _short_results(task: dict[str, Any]) -> list[Any]:
    """Keypoints of JSON-MIN, which keeps them under the name of the control tag."""
    for value in task.values():
        if isinstance(value, list) and any(
            isinstance(entry, dict) and "keypointlabels" in entry for entry in value
        ):
            return value
    return []


def _results(reading: Reading, task: dict[str, Any], called: str) -> object:
    if not _has_results(task):
        return _short_results(task)
    annotations = [
        entry
        for entry in reading.objects(
            next(task[key] for key in _RESULTS if task.get(key)), f"the annotations of {called}"
        )
        if not entry.get("was_cancelled")
    ]
    reading.left_out["further annotations of a task"] += max(0, len(annotations) - 1)
    return annotations[0].get("result") if annotations else None


def _labelled(reading: Reading, region: dict[str, Any], called: str) -> LabelledPoint | None:
    """A keypoint in pixels; None for a region of another kind."""
    value = region.get("value", region)
    if not isinstance(value, dict) or not isinstance(value.get("keypointlabels"), list):
        reading.left_out["regions that are no keypoints"] += 1
        return None
    where = f"keypoint {region.get('id', '')} of {called}"
    size = _size(region)
    if size is None:
        raise reading.error(where, region, "`original_width` and `original_height`")
    if region.get("image_rotation"):
        raise ValueError(
            f"{reading.path}: {called} was labelled on an image turned by {region['image_rotation']!r:.20} "
            "degrees, and its keypoints are in the turned image. Turn the image file instead, and label that."
        )
    share = reading.numbers([value.get("x"), value.get("y")], where, 2) / 100
    label = " ".join(str(word) for word in value["keypointlabels"])
    parent = first_of(region, ("parentID", "parent_id"))
    return LabelledPoint(
        label, (share[0] * size[0], share[1] * size[1]), "" if parent is None else f"{parent!s:.40}"
    )


def _size(region: dict[str, Any]) -> tuple[float, float] | None:
    # JSON-MIN has the point's own width beside the image's.
    return size_of({key: region.get(f"original_{key}") for key in ("width", "height")})


def _image(task: dict[str, Any]) -> str | None:
    """File name of a task's image, out of its address."""
    data = task.get("data", task)
    named = data if isinstance(data, Mapping) else {}
    address = first_of(named, ("image", "img", "ocr", "file_upload"))
    if not isinstance(address, str):
        return None
    try:
        parts = urlsplit(address)
        local = parse_qs(parts.query).get("d")
    except ValueError:
        return address
    if local:
        return local[0]
    # A name may hold a question mark of its own only if it is no address.
    path = unquote(parts.path) if parts.scheme or address.startswith("/") else address
    return path.rsplit("/", 1)[-1] or None
