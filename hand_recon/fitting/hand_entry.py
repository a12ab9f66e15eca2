"""One hand of a file of hands: its keys, and the check of their values."""

import json
from collections.abc import Iterable
from dataclasses import fields
from typing import Any, Final, NoReturn

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hand_records import CAMERAS, SHAPES, VERDICTS
from hand_recon.fitting.origin import Moment
from hand_recon.hand.skeleton import ARTICULATED, AXES

OPTIONAL: Final = frozenset({"score", "observed_2d", "sigma_2d", "covariance_3d", "residual"})
"""Keys that may be null for a hand with a result."""

KEYS: Final = (
    "image", "name", "side", "score", "verdict", "reasons", "landmarks_3d", "landmarks_2d", "observed_2d",
    "sigma_2d", "covariance_3d", "joint_angles_degrees", "shape", "root_rotation", "translation", "camera",
    "residual", "loss", "source", "hand_model", "version",
)  # fmt: skip
"""Keys of a hand's object, in their order."""

CLIP: Final = "clip"
"""Key of a hand's place in its clip, which hands of photographs do not have."""

ALSO_WITHOUT_FIT: Final = frozenset({"score", "observed_2d"})
"""Numbers that a hand without a result may have."""

_CAMERA: Final = ("intrinsics", "source", "image_size")
_RESULTS: Final = (*KEYS[6:8], *KEYS[9:18])


class HandEntry:
    """The values of one hand of a file, checked against the format.

    Raises:
        ValueError: The hand differs from the format.
    """

    def __init__(self, where: str, entry: object) -> None:
        self.where = where
        content = self._object(entry, "the hand", KEYS, {CLIP})
        self.content = content
        self._check_texts(content)
        self.moment = self._moment(content.get(CLIP))
        self.camera: str | None = None
        self.image_size: tuple[int, int] | None = None
        self.loss: dict[str, float] = {}
        self.numbers = {key: np.full(shape, np.nan) for key, shape in SHAPES.items()}
        for key in ALSO_WITHOUT_FIT:
            self._read_number(key, content[key])
        if content["verdict"] != "not fitted":
            self._read_results(content)
            return
        for key in _RESULTS:
            if content[key] is not None:
                self._refuse(key, content[key], "null, because the hand is not fitted")

    def _check_texts(self, content: dict[str, Any]) -> None:
        for key in ("name", "source", "hand_model", "version"):
            if not isinstance(content[key], str):
                self._refuse(key, content[key], "a string")
        if not isinstance(content["image"], str | None):
            self._refuse("image", content["image"], "a file name or null")
        self._choice("side", content["side"], ("left", "right"))
        self._choice("verdict", content["verdict"], VERDICTS)
        reasons = content["reasons"]
        if not isinstance(reasons, list) or not all(isinstance(one, str) for one in reasons):
            self._refuse("reasons", reasons, "a list of sentences")

    def _read_results(self, content: dict[str, Any]) -> None:
        camera = self._object(content["camera"], "'camera'", _CAMERA)
        self._choice("camera source", camera["source"], CAMERAS)
        self.camera, self.image_size = camera["source"], self._size(camera["image_size"])
        angles = self._object(
            content["joint_angles_degrees"], "'joint_angles_degrees'", ARTICULATED
        )
        rows = [self._object(angles[joint], joint, AXES) for joint in ARTICULATED]
        values = content | {
            "intrinsics": camera["intrinsics"],
            "joint_angles_degrees": [[row[axis] for axis in AXES] for row in rows],
        }
        for key in SHAPES:
            self._read_number(key, values[key])
        if not isinstance(content["loss"], dict):
            self._refuse("loss", content["loss"], "an object with a number per term")
        for term, value in content["loss"].items():
            number = np.asarray(np.nan) if value is None else self._numbers(term, value, ())
            self.loss[term] = float(number)

    def _read_number(self, key: str, value: object) -> None:
        if value is None and key in OPTIONAL:
            return
        if key == "observed_2d" and isinstance(value, list):
            missing = [row is None for row in value]
            filled = [[0.0, 0.0] if row is None else row for row in value]
            self.numbers[key] = self._numbers(key, filled, SHAPES[key])
            self.numbers[key][missing] = np.nan
            return
        self.numbers[key] = self._numbers(key, value, SHAPES[key])

    def _size(self, value: object) -> tuple[int, int] | None:
        if value is None:
            return None
        array = self._numbers("image_size", value, (2,))
        return int(array[0]), int(array[1])

    def _choice(self, key: str, value: object, choices: tuple[str, ...]) -> None:
        if value not in choices:
            self._refuse(key, value, " or ".join(repr(choice) for choice in choices))

    def _moment(self, value: object) -> Moment | None:
        if value is None:
            return None
        clip = self._object(value, f"'{CLIP}'", tuple(field.name for field in fields(Moment)))
        hand, frame = (self._numbers(key, clip[key], ()) for key in ("hand", "frame"))
        if hand % 1 or frame % 1 or hand < 1 or frame < 0:
            self._refuse(
                "hand or frame", [clip["hand"], clip["frame"]], "whole numbers from 1 and 0"
            )
        time = float(self._numbers("time", clip["time"], ()))
        if not isinstance(clip["seen"], bool):
            self._refuse("seen", clip["seen"], "true or false")
        return Moment(int(hand), int(frame), time, clip["seen"])

    def _object(
        self, value: object, what: str, keys: tuple[str, ...], also: Iterable[str] = ()
    ) -> dict[str, Any]:
        if not isinstance(value, dict):
            self._refuse(what, value, f"an object with the keys {', '.join(keys)}")
        missing = "".join(f" without {key}" for key in keys if key not in value)
        allowed = {*keys, *also}
        unknown = "".join(f" with the unknown key {key}" for key in value if key not in allowed)
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
