"""The file format of reconstructed hands, `hands.json`: a JSON list with one object per hand, one to a line.

An object has these keys, in this order; `hands.schema.json` beside this module is the JSON schema.

    image, name          the image's file name, null without one; the hand's name
    side, score          `left` or `right`; the detector's score, 0 to 1, null without one
    verdict, reasons     `plausible`, `doubtful` or `not fitted`, and why; of a hand that is not fitted, all
                         numbers that follow are null but `observed_2d`
    landmarks_3d         21×3, metres, camera frame (x right, y down, z forward)
    landmarks_2d         21×2, projections of `landmarks_3d`, pixels of the image
    observed_2d          21×2, the landmarks that the hand was fitted to; null for one that is missing
    sigma_2d             21×2, standard deviations, pixels of the image; null without an estimate
    covariance_3d        21×3×3, of a landmark from the hand's origin (`translation`), axes of the camera,
                         square metres; null without an estimate
    joint_angles_degrees by joint: bend, splay and twist
    shape                10, standard deviations
    root_rotation        3×3, from the hand's frame to the camera's
    translation          3, origin of the hand's frame in the camera's, metres
    camera               intrinsics 3×3, pixels of the image; source: `given`, `EXIF`, `field of view`,
                         `assumed`, or `none` for hands that no camera saw; image_size: width and height,
                         null if unknown
    residual             mean distance to the observed landmarks, pixels of the image; null without any
    loss                 value of every term of the loss by name, null where it is not finite
    source               steps that made the hand, such as `mediapipe, fit`
    hand_model, version  `open` or `mano`; the version of hand_recon
    clip                 of hands of a clip alone: hand (number, from 1), frame (from 0), time (seconds), and
                         seen, which is false where a gap was bridged

Numbers are rounded to `DECIMALS`.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from hand_recon.fitting.hand_entry import ALSO_WITHOUT_FIT, CLIP, KEYS, OPTIONAL, HandEntry
from hand_recon.fitting.hand_records import SHAPES, HandRecords
from hand_recon.fitting.hands_lines import SUFFIX, read_lines, refuse_constant
from hand_recon.fitting.hands_list import writing_entries
from hand_recon.fitting.origin import Moment
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.reading.text import parse_json, read_text

DECIMALS: Final[Mapping[str, int]] = {
    "score": 4,
    "landmarks_3d": 7,
    "landmarks_2d": 4,
    "observed_2d": 4,
    "sigma_2d": 4,
    "covariance_3d": 12,
    "joint_angles_degrees": 4,
    "shape": 5,
    "root_rotation": 8,
    "translation": 7,
    "intrinsics": 6,
    "residual": 4,
    "loss": 6,
    "time": 6,
}
"""Decimals that are written of each number."""


def hand_entries(hands: HandRecords) -> Iterator[dict[str, Any]]:
    """Make the JSON objects of hands, one per hand, rounded to `DECIMALS`."""
    numbers = {key: getattr(hands, key).round(DECIMALS[key]).tolist() for key in SHAPES}
    loss = {term: values.round(DECIMALS["loss"]).tolist() for term, values in hands.loss.items()}
    for hand, fitted in enumerate(hands.fitted.tolist()):
        row = {
            key: _json(key, values[hand]) if fitted or key in ALSO_WITHOUT_FIT else None
            for key, values in numbers.items()
        }
        camera = {
            "intrinsics": row.pop("intrinsics"),
            "source": hands.cameras[hand],
            "image_size": _json_size(hands.image_sizes[hand]),
        }
        if fitted:
            row["joint_angles_degrees"] = _by_name(numbers["joint_angles_degrees"][hand])
        entry = row | {
            "image": hands.images[hand],
            "name": hands.names[hand],
            "side": hands.sides[hand],
            "verdict": hands.verdicts[hand],
            "reasons": list(hands.reasons[hand]),
            "camera": camera if fitted else None,
            "loss": {term: _finite(values[hand]) for term, values in loss.items()}
            if fitted
            else None,
            "source": hands.sources[hand],
            "hand_model": hands.hand_models[hand],
            "version": hands.versions[hand],
        }
        moment = hands.moments[hand]
        of_clip = {} if moment is None else {CLIP: _clip(moment)}
        yield {key: entry[key] for key in KEYS} | of_clip


def _clip(moment: Moment) -> dict[str, Any]:
    """Place of a hand in its clip."""
    return asdict(moment) | {"time": round(moment.time, DECIMALS["time"])}


def _by_name(angles: list[list[float]]) -> dict[str, dict[str, float]]:
    """Joint angles by joint and axis."""
    return {
        joint: dict(zip(AXES, values, strict=True))
        for joint, values in zip(ARTICULATED, angles, strict=True)
    }


def _json(key: str, values: Any) -> Any:  # noqa: ANN401  # nested lists of numbers, or a number
    """Numbers as JSON holds them: None for missing points, and for an optional number that is missing."""
    if key not in OPTIONAL:
        return values
    if not isinstance(values, list):
        return _finite(values)
    if key == "observed_2d":
        values = [None if math.isnan(u) or math.isnan(v) else [u, v] for u, v in values]
        return None if all(point is None for point in values) else values
    return None if np.isnan(values).all() else values


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _json_size(size: tuple[int, int] | None) -> list[int] | None:
    return None if size is None else list(size)


@contextmanager
def writing_hands(
    path: Path, done: Iterable[dict[str, Any]] | None = None
) -> Iterator[Callable[[HandRecords], None]]:
    """Write a file of hands part by part; as `writing_entries`.

    Args:
        path: The file.
        done: Objects of hands of an interrupted run, which the list begins with.

    Raises:
        FileExistsError: An unfinished file of this name exists.
        ValueError: A number that must be finite is not.
    """
    with writing_entries(path, done) as write:
        yield lambda hands: write(hand_entries(hands))


def entries_so_far(path: Path) -> list[dict[str, Any]]:
    """Read the objects that an interrupted run wrote to a file of hands, with or without `.part`."""
    unfinished = path.with_name(f"{path.name}.part")
    return list(finished_entries(unfinished if unfinished.exists() else path))


def finished_entries(path: Path) -> Iterator[dict[str, Any]]:
    """Read the objects of an unfinished file of hands whose lines are whole, as far as they go.

    Args:
        path: The file; nothing is read if it does not exist.
    """
    if not path.is_file():
        return
    with path.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            text = line.strip().lstrip("[").removesuffix(",").removesuffix("]").strip()
            if not text:
                continue
            try:
                entry = json.loads(text)
            except (ValueError, RecursionError):
                return
            if not isinstance(entry, dict) or not set(KEYS) <= set(entry):
                return
            yield entry


def read_hands(path: str | Path) -> HandRecords:
    """Read a file of hands, and check it against the format.

    Args:
        path: File with a list (`hands.json`), or with the suffix `.jsonl` and one hand to a line.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no JSON list of hands, or a hand differs from the format.
    """
    path = Path(path).expanduser()
    if not path.is_file():
        raise FileNotFoundError(
            f"No file of hands at {path}. Give a file such as the hands.json that hand-recon fit and predict "
            "write."
        )
    if path.suffix.lower() == SUFFIX:
        return to_records(read_lines(path), str(path))
    text = read_text(path, "utf-8")
    try:
        content = parse_json(text, path, refuse_constant)
    except ValueError as error:
        if error.__cause__ is None:
            raise
        raise ValueError(
            f"{path} is not JSON ({error.__cause__}); expected a list of hands. Write the file again."
        ) from error
    if not isinstance(content, list):
        raise ValueError(
            f"{path} holds a JSON {type(content).__name__}; expected a list with one object per hand. "
            "Give a file such as the hands.json that hand-recon fit and predict write."
        )
    return to_records(content, str(path))


def to_records(content: list[Any], where: str) -> HandRecords:
    """Check the objects of hands against the format, and make their records.

    Args:
        content: Objects as the format describes them.
        where: The file, for messages.

    Raises:
        ValueError: A hand differs from the format.
    """
    return _joined(
        [HandEntry(f"{where}, hand {hand}", value) for hand, value in enumerate(content)]
    )


def _joined(entries: list[HandEntry]) -> HandRecords:
    """The record of all hands of a file."""

    def column(key: str) -> tuple[Any, ...]:
        return tuple(entry.content[key] for entry in entries)

    terms = dict.fromkeys(term for entry in entries for term in entry.loss)
    numbers = {
        key: np.array([entry.numbers[key] for entry in entries]).reshape(len(entries), *shape)
        for key, shape in SHAPES.items()
    }
    return HandRecords(
        names=column("name"),
        images=column("image"),
        sides=column("side"),
        verdicts=column("verdict"),
        reasons=tuple(tuple(reasons) for reasons in column("reasons")),
        cameras=tuple(entry.camera for entry in entries),
        image_sizes=tuple(entry.image_size for entry in entries),
        sources=column("source"),
        hand_models=column("hand_model"),
        versions=column("version"),
        moments=tuple(entry.moment for entry in entries),
        loss={
            term: np.array([entry.loss.get(term, math.nan) for entry in entries]) for term in terms
        },
        **numbers,
    )
