"""Labels of the hands of one image, as the JSON member beside the image in a shard (decision 98).

Numbers are written with all their digits: a training from shards has the labels of one from the files, bit
for bit.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.annotations import AnnotatedHands
from hand_recon.reading.naming import OTHER_FORM

FIELDS: Final = ("person", "split", "source", "licence")
"""Facts on an image that are carried along as text, where they are known."""

_SIDES: Final = ("right", "left")


def labels_to_json(
    hands: AnnotatedHands,
    rows: Sequence[int],
    facts: Mapping[str, str],
    scale: tuple[float, float] = (1.0, 1.0),
) -> bytes:
    """Labels of the hands of one image.

    Args:
        hands: The table.
        rows: Rows of the hands, one or more, of one image.
        facts: Some of `FIELDS`.
        scale: Width and height of the image in the shard, as shares of those of the image that was labelled.
    """
    entries = [_to_entry(hands, row, np.array(scale)) for row in rows]
    content = {"image": hands.source(rows[0]), **facts, "hands": entries}
    return json.dumps(content, ensure_ascii=False, allow_nan=False).encode()


def _to_entry(
    hands: AnnotatedHands, row: int, scale: Float[np.ndarray, " coordinate=2"]
) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "landmarks": _listed(hands.landmarks_2d[row] * scale),
        "side": _SIDES[hands.is_left(row)],
    }
    if hands.boxes is not None:
        entry["box"] = _listed(hands.boxes[row] * np.tile(scale, 2))
    if hands.label_noise is not None:
        entry["sigma"] = _listed(hands.label_noise[row] * np.sqrt(scale.prod()))
    if hands.confidence is not None:
        entry["confidence"] = _listed(hands.confidence[row])
    if hands.occluded is not None:
        entry["occluded"] = hands.occluded[row].tolist()
    if hands.intrinsics is not None and np.isfinite(hands.intrinsics[row]).all():
        entry["intrinsics"] = (np.diag([*scale, 1.0]) @ hands.intrinsics[row]).tolist()
    return entry


def _listed(values: np.ndarray) -> list[Any]:
    """Numbers or points as JSON holds them, null for one that is missing."""
    known = np.isfinite(values) if values.ndim == 1 else np.isfinite(values).all(axis=1)
    return [value if there else None for value, there in zip(values.tolist(), known, strict=True)]


def labels_from_json(content: bytes, name: str) -> AnnotatedHands:
    """The table of the hands of one image.

    Args:
        content: What `labels_to_json` wrote.
        name: Name of the dataset.

    Raises:
        ValueError: It is something else, or a number in it is not finite.
    """
    try:
        labels = json.loads(content.decode(), parse_constant=_refuse)
        entries, image = labels["hands"], str(labels["image"])
        return AnnotatedHands(
            name=name,
            root=Path(),
            images=[Path(image)] * len(entries),
            fingerprint="",
            landmarks_2d=_array([_points(entry["landmarks"]) for entry in entries], (21, 2)),
            left=np.array([entry["side"] == "left" for entry in entries]),
            boxes=_column(entries, "box", (4,)),
            label_noise=_column(entries, "sigma", (21,)),
            confidence=_column(entries, "confidence", (21,)),
            occluded=_occluded(entries),
            intrinsics=_column(entries, "intrinsics", (3, 3)),
        )
    except OTHER_FORM as error:
        raise ValueError(f"no labels of an image ({type(error).__name__}: {error})") from error


def _refuse(constant: str) -> object:
    raise ValueError(f"{constant} is no number; a missing label is null")


def _points(points: list[list[float] | None]) -> list[list[float]]:
    return [[np.nan, np.nan] if point is None else point for point in points]


def _array(values: object, shape: tuple[int, ...]) -> np.ndarray:
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape[1:] != shape:
        raise ValueError(f"found {numbers.shape[1:]} numbers, expected {shape}")
    # NaN stands for null.
    if np.isinf(numbers).any():
        raise ValueError("found a number that no double can hold, expected finite ones")
    return numbers


def _column(entries: list[dict[str, Any]], key: str, shape: tuple[int, ...]) -> np.ndarray | None:
    """A column of numbers, NaN where there is none; None if no hand has it."""
    if not any(key in entry for entry in entries):
        return None
    missing = np.full(shape, np.nan)
    return _array([entry.get(key, missing) for entry in entries], shape)


def _occluded(entries: list[dict[str, Any]]) -> np.ndarray | None:
    if not all("occluded" in entry for entry in entries):
        return None
    flags = np.array([entry["occluded"] for entry in entries])
    if flags.shape[1:] != (21,) or flags.dtype != np.bool_:
        raise ValueError("found other values than 21 true or false in `occluded`")
    return flags
