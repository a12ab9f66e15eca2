"""Columns of hands in tables: names, types and units.

A hand is a struct. Its first four fields are those of `daft-physical-ai`'s `track_hands`; the others are
those of a file of hands (docs/hands_file.md). Numbers are in single precision, a point that is missing is
null, and of a hand that is not fitted all results are null.

    handedness           `left` or `right`, the true side
    confidence           the detector's score, 0 to 1; null without one
    kp2d                 21×2, projections of `kp3d`, pixels of the image (pixel i covers [i, i + 1))
    kp3d                 21×3, metres, camera frame (x right, y down, z forward)
    verdict, reasons     `plausible`, `doubtful` or `not fitted`, and why
    observed_2d          21×2, the landmarks that the hand was fitted to, pixels
    sigma_2d             21×2, standard deviations, pixels
    covariance_3d        21×3×3, of a landmark from the hand's origin, square metres
    joint_angles_degrees 15×3, bend, splay and twist of the joints of `skeleton.ARTICULATED`
    shape                10, standard deviations
    root_rotation        3×3, from the hand's frame to the camera's
    translation          3, origin of the hand's frame in the camera's, metres
    intrinsics, camera   3×3, pixels of the image, and the source of that matrix
    residual             mean distance to the observed landmarks, pixels
    source               steps that made the hand, such as `mediapipe, lifter, fit`
    hand_model, version  `open` or `mano`; the version of hand_recon
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from hand_recon.fitting.hand_records import SHAPES, HandRecords
from hand_recon.scale.extra import arrow_module

NUMBERS: Final[Mapping[str, str]] = {
    "confidence": "score",
    "kp2d": "landmarks_2d",
    "kp3d": "landmarks_3d",
    "observed_2d": "observed_2d",
    "sigma_2d": "sigma_2d",
    "covariance_3d": "covariance_3d",
    "joint_angles_degrees": "joint_angles_degrees",
    "shape": "shape",
    "root_rotation": "root_rotation",
    "translation": "translation",
    "intrinsics": "intrinsics",
    "residual": "residual",
}
"""Numbers of a hand: the field of the struct, and that of `HandRecords`."""

TEXTS: Final[Mapping[str, str]] = {
    "handedness": "sides",
    "verdict": "verdicts",
    "camera": "cameras",
    "source": "sources",
    "hand_model": "hand_models",
    "version": "versions",
}
"""Texts of a hand: the field of the struct, and that of `HandRecords`."""

HAND: Final = (
    "handedness", "confidence", "kp2d", "kp3d", "verdict", "reasons", "observed_2d", "sigma_2d",
    "covariance_3d", "joint_angles_degrees", "shape", "root_rotation", "translation", "intrinsics", "camera",
    "residual", "source", "hand_model", "version",
)  # fmt: skip
"""Fields of a hand, in their order."""

AUDIT_NUMBERS: Final = (
    "worst_range_degrees", "worst_anatomy_degrees", "depth_mm", "residual_mm", "worst_bone_error",
)  # fmt: skip
"""Measurements of an audited hand; null where there is none."""


def hand_type() -> Any:  # noqa: ANN401  # pyarrow.DataType
    """Arrow's type of one hand."""
    arrow = arrow_module()
    fields = {key: _nested(len(SHAPES[record])) for key, record in NUMBERS.items()}
    fields |= dict.fromkeys(TEXTS, arrow.string())
    fields["reasons"] = arrow.list_(arrow.string())
    return arrow.struct([(key, fields[key]) for key in HAND])


def image_type() -> Any:  # noqa: ANN401  # pyarrow.DataType
    """Arrow's type of an image's result: its hands, its size in pixels, and the reason if it has none."""
    arrow = arrow_module()
    return arrow.struct(
        [
            ("hands", arrow.list_(hand_type())),
            ("width", arrow.int32()),
            ("height", arrow.int32()),
            ("error", arrow.string()),
        ]
    )


def group_type() -> Any:  # noqa: ANN401  # pyarrow.DataType
    """Arrow's type of the results of a group of images."""
    return arrow_module().list_(image_type())


def fit_type() -> Any:  # noqa: ANN401  # pyarrow.DataType
    """Arrow's type of a hand that is fitted to given landmarks, and of the reason if there is none."""
    arrow = arrow_module()
    return arrow.struct([("hand", hand_type()), ("error", arrow.string())])


def audit_type() -> Any:  # noqa: ANN401  # pyarrow.DataType
    """Arrow's type of a verdict on given 3D landmarks, with the measurements that it follows from."""
    arrow = arrow_module()
    return arrow.struct(
        [
            ("verdict", arrow.string()),
            ("reasons", arrow.list_(arrow.string())),
            ("handedness", arrow.string()),
            *((name, arrow.float32()) for name in AUDIT_NUMBERS),
            ("joint_angles_degrees", _nested(2)),
            ("error", arrow.string()),
        ]
    )


def _nested(depth: int) -> Any:  # noqa: ANN401  # pyarrow.DataType
    arrow = arrow_module()
    kind = arrow.float32()
    for _ in range(depth):
        kind = arrow.list_(kind)
    return kind


def hand_structs(records: HandRecords) -> list[dict[str, Any]]:
    """Hands as the structs of a table, one per hand.

    Args:
        records: The hands.
    """
    return [
        {key: getattr(records, record)[hand] for key, record in TEXTS.items()}
        | {key: numbers(getattr(records, record)[hand]) for key, record in NUMBERS.items()}
        | {"reasons": list(records.reasons[hand])}
        for hand in range(len(records))
    ]


def numbers(values: Any) -> Any:  # noqa: ANN401  # an array or a number; lists, a number or None
    """Numbers in single precision as lists: None for missing ones, and for points with a missing number.

    Args:
        values: An array of any shape, or a number; NaN where missing.
    """
    array = np.asarray(values, dtype=np.float32)
    missing = np.isnan(array)
    if missing.all():
        return None
    found: Any = array.tolist()
    if array.ndim > 1 and missing.any():
        lost = np.any(missing.reshape(len(array), -1), axis=1, keepdims=True)[:, 0].tolist()
        return [None if gone else row for gone, row in zip(lost, found, strict=True)]
    return found


def failed_image(error: str, size: Sequence[int] | None = None) -> dict[str, Any]:
    """Result of an image that could not be processed.

    Args:
        error: The reason.
        size: Width and height, pixels; None if they are not known.
    """
    width, height = size or (None, None)
    return {"hands": None, "width": width, "height": height, "error": error}
