"""mmpose's and RTMPose's predictions: `keypoints` of each instance with `keypoint_scores` beside them.

Read are the files of MMPoseInferencer, a list of instances for one image or a list of frames with
`instances`, and of the older demos, an object with `meta_info` and `instance_info`. Instances have 21
keypoints (a hand) or 133 or 136 (a whole body); bodies without hands are left out.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.data.landmarks.formats.found import (
    FoundHand,
    Reading,
    first_of,
    text_of,
)
from hand_recon.data.landmarks.formats.names import side_in
from hand_recon.data.landmarks.formats.whole_body import layout_of, pick
from hand_recon.data.landmarks.parsed import ParsedHands

TITLE: Final = "mmpose's predictions"

SCORES: Final = ("keypoint_scores", "keypoints_visible")
"""Keys of the scores."""

_LISTS: Final = ("instance_info", "predictions")
_INSTANCES: Final = ("instances", "preds", "predictions")


def is_mmpose(content: object) -> bool:
    """True for mmpose's predictions of an image or a video."""
    if isinstance(content, dict) and any(isinstance(content.get(key), list) for key in _LISTS):
        return "annotations" not in content
    entries = _unnested(content) if isinstance(content, list) else []
    return any(
        isinstance(entry, dict)
        and (
            ("keypoints" in entry and any(key in entry for key in SCORES))
            or isinstance(entry.get("instances"), list)
        )
        for entry in entries
    )


def parse_mmpose(path: Path, content: Any) -> ParsedHands:  # noqa: ANN401  # any JSON
    """The hands of all instances; of a whole body, the left one first.

    Raises:
        ValueError: There are none, or something else is in their place.
    """
    reading = Reading(path, TITLE)
    names = _names(content)
    entries = first_of(content, _LISTS) if isinstance(content, dict) else content
    for frame, instance, called in _instances(reading, _unnested(entries)):
        _add_instance(reading, {**frame, **instance}, called, names)
    return reading.parsed()


def _unnested(entries: list[Any]) -> list[Any]:
    """The entries of a list, and those of lists in it: MMPoseInferencer has a list for each image."""
    return [inner for entry in entries for inner in (entry if isinstance(entry, list) else [entry])]


def _instances(
    reading: Reading, entries: list[Any]
) -> Iterator[tuple[dict[str, Any], dict[str, Any], str]]:
    """Each instance with what its frame says of it, and its name."""
    for position, entry in enumerate(reading.objects(entries, "the list of instances")):
        instances = first_of(entry, _INSTANCES)
        if instances is None:
            yield {}, entry, f"instance {position}"
            continue
        frame = text_of(entry.get("frame_id", entry.get("img_path"))) or str(position)
        about: dict[str, Any] = {
            key: entry[key] for key in ("img_path", "image", "file_name") if key in entry
        }
        found = reading.objects(_unnested(reading.entries(instances, f"frame {frame}")), frame)
        for number, instance in enumerate(found):
            yield about, instance, f"frame {frame}, instance {number}"


def _names(content: object) -> list[str]:
    """Names of the keypoints by `meta_info`; empty without."""
    about = content.get("meta_info") if isinstance(content, dict) else None
    names = about.get("keypoint_id2name") if isinstance(about, dict) else None
    if isinstance(names, dict):
        return [str(name) for name in names.values()]
    return [str(name) for name in names] if isinstance(names, list) else []


def _add_instance(
    reading: Reading, instance: dict[str, Any], called: str, names: list[str]
) -> None:
    keypoints = instance.get("keypoints")
    flat = isinstance(keypoints, list) and bool(keypoints) and not isinstance(keypoints[0], list)
    where = f"`keypoints` of {called}"
    shape = (-1,) if flat else (-1, -1)
    points = reading.numbers(keypoints, where, *shape, missing=True)
    scores = first_of(instance, SCORES)
    if flat:
        size = 2 if scores is not None and 2 * len(_list(scores)) == len(points) else 3
        if len(points) % size:
            raise reading.error(where, keypoints, "two or three numbers per keypoint")
        points = points.reshape(-1, size)
    layout = layout_of(len(points), names)
    if layout is None:
        reading.left_out[f"bodies of {len(points)} keypoints"] += 1
        return
    reading.named |= layout.named
    if points.shape[1] not in {2, 3}:
        raise reading.error(where, keypoints, "[u, v] per keypoint")
    score = points[:, 2] if points.shape[1] == 3 else np.full(len(points), np.nan)
    if scores is not None:
        score = reading.numbers(scores, f"the scores of {called}", len(points), missing=True)
    image = text_of(first_of(instance, ("img_path", "image", "file_name")))
    for side, places in layout.hands.items():
        reading.add(
            FoundHand(
                pick(points[:, :2], places),
                side or side_in(first_of(instance, ("handedness", "label", "category")) or ""),
                f"{called} {side}" if side else called,
                image,
                confidence=pick(score, places),
            )
        )


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []
