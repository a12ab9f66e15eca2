"""Hands as files of any origin give them: joint angles exactly, or 3D landmarks alone."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from hand_recon.fitting.origin import Moment
from hand_recon.schema import HandParameters


@dataclass(frozen=True)
class GivenCamera:
    """Image and camera of a hand, which a file of hands has and points have not."""

    intrinsics: Float[np.ndarray, "3 3"]
    """Camera matrix, pixels of the image."""
    source: str
    """Source of the matrix, one of `hand_recon.fitting.hand_records.CAMERAS`."""
    image: str | None
    """File name of the image; None without one."""
    image_size: tuple[int, int] | None
    """Width and height of the image, pixels; None if unknown."""


@dataclass(frozen=True)
class GivenHands:
    """Hands to audit, one row per hand; numbers that a source does not give are NaN."""

    names: tuple[str, ...]
    """Name of each hand, unique within its file."""
    files: tuple[str, ...]
    """File of each hand."""
    points: Float[Tensor, "hand landmark=21 3"]
    """Landmarks in the file's unit and frame, left hands as left hands."""
    left: tuple[bool | None, ...]
    """True for left hands, as their points show; None where the source does not say."""
    sides: tuple[str, ...]
    """Side that the source names, `left`, `right` or empty; its points may be mirrored all the same."""
    parameters: HandParameters
    """Pose and shape of the right hand, or of the right hand that mirrors a left one, in the file's frame."""
    hand_models: tuple[str, ...]
    """Hand model of the parameters, `open` or `mano`; empty for landmarks alone."""
    sequences: tuple[str, ...]
    """Name of the sequence that each hand is a frame of; empty for single hands."""
    times: Float[Tensor, " hand"]
    """Time of each frame of a sequence, seconds."""
    cameras: tuple[GivenCamera | None, ...]
    """Camera of each hand; None for hands without one."""
    moments: tuple[Moment | None, ...]
    """Place of each hand in its clip, as a file of hands has it; None without one."""
    notes: tuple[str, ...] = ()
    """Sentences about what was assumed in reading."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def exact(self) -> Bool[Tensor, " hand"]:
        """Mask of the hands whose joint angles are given."""
        return self.parameters.joint_angles.isfinite().flatten(1).all(dim=1)

    def with_points(self, points: Float[Tensor, "hand landmark=21 3"]) -> Self:
        """These hands with other landmarks."""
        return replace(self, points=points)

    def with_notes(self, *notes: str) -> Self:
        """These hands with further notes."""
        return replace(self, notes=(*self.notes, *notes))


def of_points(
    points: Float[Tensor, "hand landmark=21 3"],
    file: str,
    *,
    names: Sequence[str] | None = None,
    left: Sequence[bool | None] | None = None,
    sides: Sequence[str] | None = None,
) -> GivenHands:
    """Hands of which landmarks are known.

    Args:
        points: Any unit and frame; NaN where missing.
        file: Their file.
        names: Names; their numbers in the file by default.
        left: True for left hands; unknown by default.
        sides: Sides that the source names; none by default.
    """
    count = len(points)
    return GivenHands(
        tuple(str(row) for row in range(count)) if names is None else tuple(names),
        (file,) * count,
        points.float(),
        (None,) * count if left is None else tuple(left),
        ("",) * count if sides is None else tuple(sides),
        unknown_parameters(count),
        ("",) * count,
        ("",) * count,
        torch.full((count,), torch.nan),
        (None,) * count,
        (None,) * count,
    )


def unknown_parameters(count: int) -> HandParameters:
    """Parameters of hands that are not known: NaN."""
    shapes = (15, 3), (10,), (3, 3), (3,)
    return HandParameters(*(torch.full((count, *shape), torch.nan) for shape in shapes))


def joined_hands(parts: Sequence[GivenHands]) -> GivenHands:
    """Hands of several files as one record.

    Raises:
        ValueError: There is no hand.
    """
    if not any(len(part) for part in parts):
        raise ValueError(
            "The files hold no hand; expected one or more. Give files of hands or of 3D landmarks."
        )
    values: dict[str, Any] = {}
    for entry in fields(GivenHands):
        columns = [getattr(part, entry.name) for part in parts]
        if isinstance(columns[0], tuple):
            values[entry.name] = tuple(value for column in columns for value in column)
        elif isinstance(columns[0], HandParameters):
            values[entry.name] = HandParameters.join(columns)
        else:
            values[entry.name] = torch.cat(columns)
    values["notes"] = tuple(dict.fromkeys(values["notes"]))
    return GivenHands(**values)


def rows_by(keys: Sequence[str]) -> dict[str, list[int]]:
    """Rows of each key, in the order in which keys appear."""
    found: dict[str, list[int]] = {}
    for row, key in enumerate(keys):
        found.setdefault(key, []).append(row)
    return found


def as_array(values: Tensor) -> np.ndarray:
    """A tensor as a NumPy array in double precision."""
    return values.detach().double().cpu().numpy()
