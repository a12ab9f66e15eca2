"""The file format of reconstructed hands: a JSON list with one object per hand, one to a line.

An object has these keys, in this order:

    name, side           the hand's name; `left` or `right`
    fitted               false for a hand without a result; all keys that follow are null then
    landmarks_3d         21×3, metres, camera frame (x right, y down, z forward)
    landmarks_2d         21×2, projections of `landmarks_3d`, pixels of the image
    joint_angles_degrees 15×3, bend, splay and twist of the joints that `joints.json` names
    shape                10, standard deviations
    sigma                21×2, pixels of the image; null without an estimate
    residual             mean distance to the given landmarks, pixels of the image; null without any
    camera               rotation 3×3 and translation 3 (metres) from the hand's frame to the camera's;
                         intrinsics 3×3, pixels of the image; known, false if the intrinsics were assumed
    loss                 value of every term of the loss by name, null where it is not finite

`joints.json` beside it names landmarks, joints and axes. Numbers are rounded to `DECIMALS`.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
from jaxtyping import Bool, Float

from hand_recon.hand.skeleton import ARTICULATED, AXES, LANDMARK_PARENTS, LANDMARKS

DECIMALS: Final[Mapping[str, int]] = {
    "landmarks_3d": 7,
    "landmarks_2d": 4,
    "joint_angles_degrees": 4,
    "shape": 5,
    "sigma": 4,
    "residual": 4,
    "rotation": 8,
    "translation": 7,
    "intrinsics": 6,
    "loss": 6,
}
"""Decimals that are written of each number, in the order of the keys."""

SHAPES: Final[Mapping[str, tuple[int, ...]]] = {
    "landmarks_3d": (21, 3),
    "landmarks_2d": (21, 2),
    "joint_angles_degrees": (15, 3),
    "shape": (10,),
    "sigma": (21, 2),
    "residual": (),
    "rotation": (3, 3),
    "translation": (3,),
    "intrinsics": (3, 3),
}
"""Shapes of the numbers of one hand."""

_CAMERA: Final = ("rotation", "translation", "intrinsics")
_OPTIONAL: Final = ("sigma", "residual")
_KEYS: Final = (
    "name", "side", "fitted", "landmarks_3d", "landmarks_2d", "joint_angles_degrees", "shape", "sigma",
    "residual", "camera", "loss",
)  # fmt: skip


@dataclass(frozen=True)
class HandRecords:
    """Reconstructed hands as a file holds them; numbers of hands without a result are NaN."""

    names: tuple[str, ...]
    """Name of each hand."""
    sides: tuple[str, ...]
    """Side of each hand, `left` or `right`."""
    fitted: Bool[np.ndarray, " hand"]
    """Mask of the hands with a result."""
    landmarks_3d: Float[np.ndarray, "hand landmark=21 3"]
    """Landmarks, metres, camera frame."""
    landmarks_2d: Float[np.ndarray, "hand landmark=21 2"]
    """Projected landmarks, pixels of the image."""
    joint_angles_degrees: Float[np.ndarray, "hand joint=15 axis=3"]
    """Bend, splay and twist of each joint, degrees."""
    shape: Float[np.ndarray, "hand direction=10"]
    """Shape coefficients, standard deviations."""
    sigma: Float[np.ndarray, "hand landmark=21 2"]
    """Standard deviation of each coordinate, pixels of the image; NaN without an estimate."""
    residual: Float[np.ndarray, " hand"]
    """Mean distance of the projections to the given landmarks, pixels of the image; NaN without any."""
    rotation: Float[np.ndarray, "hand 3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[np.ndarray, "hand 3"]
    """Origin of the hand's frame in the camera's, metres."""
    intrinsics: Float[np.ndarray, "hand 3 3"]
    """Camera matrix, pixels of the image."""
    intrinsics_known: Bool[np.ndarray, " hand"]
    """Mask of the hands whose camera matrix was given; false for assumed ones and hands without a result."""
    loss: Mapping[str, Float[np.ndarray, " hand"]]
    """Value of every term of the loss by name; NaN where it is not finite."""

    def __len__(self) -> int:
        return len(self.names)


def hand_entries(hands: HandRecords) -> Iterator[dict[str, Any]]:
    """Make the JSON objects of hands, one per hand, rounded to `DECIMALS`."""
    numbers = {key: _rounded(getattr(hands, key), key) for key in SHAPES}
    loss = {term: _rounded(values, "loss") for term, values in hands.loss.items()}
    for hand, fitted in enumerate(hands.fitted.tolist()):
        row = {key: values[hand] if fitted else None for key, values in numbers.items()}
        camera = {key: row.pop(key) for key in _CAMERA}
        if np.isnan(hands.sigma[hand]).all():
            row["sigma"] = None
        known = bool(hands.intrinsics_known[hand])
        yield {
            "name": hands.names[hand],
            "side": hands.sides[hand],
            "fitted": fitted,
            **row,
            "camera": {**camera, "known": known} if fitted else None,
            "loss": {term: values[hand] for term, values in loss.items()} if fitted else None,
        }


def _rounded(values: Float[np.ndarray, "..."], key: str) -> list[Any]:
    """Nested lists of rounded numbers; single numbers that are not finite become None."""
    rounded: list[Any] = values.round(DECIMALS[key]).tolist()
    if values.ndim > 1:
        return rounded
    return [value if math.isfinite(value) else None for value in rounded]


@contextmanager
def writing_hands(path: Path) -> Iterator[Callable[[HandRecords], None]]:
    """Write a file of hands part by part; the file gets its name when the list is complete.

    After an error, the parts written before it are kept as valid JSON under the file's name with `.part`.

    Raises:
        FileExistsError: An unfinished file of this name exists.
        ValueError: A number that must be finite is not.
    """
    unfinished = path.with_name(f"{path.name}.part")
    with unfinished.open("x", encoding="utf-8") as stream:
        separator = "[\n"

        def write(hands: HandRecords) -> None:
            nonlocal separator
            for entry in hand_entries(hands):
                # NaN is not JSON, and most readers refuse a file with it.
                text = json.dumps(entry, allow_nan=False, ensure_ascii=False)
                stream.write(separator + text)
                separator = ",\n"

        try:
            yield write
        finally:
            stream.write("\n]\n" if separator.startswith(",") else "[]\n")
    unfinished.rename(path)


def write_names(path: Path) -> None:
    """Write `joints.json`: names of landmarks, joints and axes, and units of the numbers."""
    names = {
        "landmarks": LANDMARKS,
        "landmark_parents": LANDMARK_PARENTS,
        "joints": ARTICULATED,
        "axes": AXES,
        "units": {
            "landmarks_3d": "metres, camera frame: x right, y down, z forward",
            "landmarks_2d": "pixels of the image, pixel i covering [i, i + 1)",
            "joint_angles_degrees": "degrees from the anatomical neutral, the straight finger",
            "shape": "standard deviations",
            "sigma": "pixels of the image",
            "residual": "pixels of the image",
        },
    }
    path.write_text(json.dumps(names, indent=2) + "\n", encoding="utf-8")


def read_hands(path: Path) -> HandRecords:
    """Read a file of hands, and check it against the format.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no JSON list of hands, or a hand differs from the format.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No file of hands at {path}. Give a file such as the fit.json that hand_recon.fit writes."
        )
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except ValueError as error:
        raise ValueError(
            f"{path} is not JSON ({error}); expected a list of hands. Write the file again."
        ) from error
    if not isinstance(content, list):
        raise ValueError(
            f"{path} holds a JSON {type(content).__name__}; expected a list with one object per hand. "
            "Give a file such as the fit.json that hand_recon.fit writes."
        )
    return _joined([_Entry(f"{path}, hand {hand}", value) for hand, value in enumerate(content)])


class _Entry:
    """The numbers of one hand, checked."""

    def __init__(self, where: str, entry: object) -> None:
        self.where = where
        content = self._object(entry, "the hand", _KEYS)
        self.name, self.side, self.fitted = (content[key] for key in ("name", "side", "fitted"))
        if not isinstance(self.name, str):
            self._refuse("name", self.name, "a string")
        if self.side not in ("left", "right"):
            self._refuse("side", self.side, "'left' or 'right'")
        if not isinstance(self.fitted, bool):
            self._refuse("fitted", self.fitted, "true or false")
        self.known = False
        self.loss: dict[str, float] = {}
        self.numbers = {key: np.full(shape, np.nan) for key, shape in SHAPES.items()}
        if self.fitted:
            self._read_numbers(content)
            return
        for key in _KEYS[3:]:
            if content[key] is not None:
                self._refuse(key, content[key], "null, because 'fitted' is false")

    def _read_numbers(self, content: dict[str, Any]) -> None:
        camera = self._object(content["camera"], "'camera'", (*_CAMERA, "known"))
        self.known = camera["known"]
        if not isinstance(self.known, bool):
            self._refuse("known", self.known, "true or false")
        for key, shape in SHAPES.items():
            value = camera[key] if key in _CAMERA else content[key]
            if value is not None or key not in _OPTIONAL:
                self.numbers[key] = self._numbers(key, value, shape)
        if not isinstance(content["loss"], dict):
            self._refuse("loss", content["loss"], "an object with a number per term")
        for term, value in content["loss"].items():
            number = np.asarray(np.nan) if value is None else self._numbers(term, value, ())
            self.loss[term] = float(number)

    def _object(self, value: object, what: str, keys: tuple[str, ...]) -> dict[str, Any]:
        if not isinstance(value, dict):
            self._refuse(what, value, f"an object with the keys {', '.join(keys)}")
        missing = "".join(f" without {key}" for key in keys if key not in value)
        unknown = "".join(f" with the unknown key {key}" for key in value if key not in keys)
        if missing or unknown:
            self._refuse(what, f"an object{missing}{unknown}", f"the keys {', '.join(keys)}")
        return value

    def _numbers(self, key: str, value: object, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
        wanted = f"finite numbers of shape {shape}" if shape else "a finite number"
        try:
            array = np.array(value)
        except ValueError:
            self._refuse(key, value, wanted)
        if array.shape != shape or array.dtype.kind not in "if" or not np.isfinite(array).all():
            self._refuse(key, value, wanted)
        return array.astype(np.float64)

    def _refuse(self, key: str, found: object, wanted: str) -> NoReturn:
        shown = json.dumps(found, ensure_ascii=False) if not isinstance(found, str) else found
        shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
        raise ValueError(
            f"{self.where}: {key} is {shown}; expected {wanted}. Write the file again with this version of "
            "hand_recon, or correct this hand."
        )


def _joined(entries: list[_Entry]) -> HandRecords:
    """The record of all hands of a file.

    Raises:
        ValueError: Hands have different terms of the loss.
    """
    fitted = [entry for entry in entries if entry.fitted]
    terms = list(fitted[0].loss) if fitted else []
    for entry in fitted:
        if set(entry.loss) != set(terms):
            raise ValueError(
                f"{entry.where}: 'loss' has the terms {sorted(entry.loss)}; expected {sorted(terms)} as in "
                "the hands before it. Put hands of different losses in different files."
            )
    numbers = {
        key: np.array([entry.numbers[key] for entry in entries]).reshape(len(entries), *shape)
        for key, shape in SHAPES.items()
    }
    return HandRecords(
        names=tuple(entry.name for entry in entries),
        sides=tuple(entry.side for entry in entries),
        fitted=np.array([entry.fitted for entry in entries], dtype=bool),
        intrinsics_known=np.array([entry.known for entry in entries], dtype=bool),
        loss={
            term: np.array([entry.loss.get(term, math.nan) for entry in entries]) for term in terms
        },
        **numbers,
    )


def _refuse_constant(token: str) -> None:
    raise ValueError(f"found {token}, which is not a JSON number")
