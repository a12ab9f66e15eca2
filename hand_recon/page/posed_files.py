"""Hands of a file of hands as scenes to play: the frames of a clip, or one photograph after the other."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch

from hand_recon.fitting.hand_records import HandRecords
from hand_recon.hand.model import HandModel
from hand_recon.motion.trajectory import mirror_of
from hand_recon.page.row_fits import PosedRecords
from hand_recon.schema import HandParameters


@dataclass(frozen=True)
class PlayedFrame:
    """One frame of a clip, or one photograph."""

    label: str
    """Text beside it."""
    time: float
    """Time since the clip's start, seconds; the number of the photograph without a clip."""
    rows: tuple[int, ...]
    """Its hands among the records."""


def played_frames(records: HandRecords) -> list[PlayedFrame]:
    """Group the hands of a file by frame, or by photograph where they are of none.

    Args:
        records: The hands.
    """
    rows: dict[tuple[float, str], list[int]] = {}
    times: dict[tuple[float, str], float] = {}
    for row, moment in enumerate(records.moments):
        name = records.images[row] or records.names[row]
        key = (-1.0, name) if moment is None else (float(moment.frame), "")
        rows.setdefault(key, []).append(row)
        times[key] = float(len(rows) - 1) if moment is None else moment.time
    if all(moment is not None for moment in records.moments):
        rows = dict(sorted(rows.items()))
    return [
        PlayedFrame(key[1] or f"Frame {key[0]:.0f}", times[key], tuple(which))
        for key, which in rows.items()
    ]


def selected(records: HandRecords, rows: Iterable[int]) -> HandRecords:
    """Some of the hands.

    Args:
        records: The hands.
        rows: Positions of those that are kept.
    """
    kept = list(rows)
    values: dict[str, Any] = {}
    for field in fields(HandRecords):
        column = getattr(records, field.name)
        if field.name == "loss":
            values["loss"] = {term: one[kept] for term, one in column.items()}
        elif isinstance(column, tuple):
            values[field.name] = tuple(column[row] for row in kept)
        else:
            values[field.name] = column[kept]
    return HandRecords(**values)


@torch.no_grad()
def posed(records: HandRecords, hand: HandModel) -> PosedRecords:
    """Pose the hands of a file again.

    Args:
        records: The hands.
        hand: Model of the right hand.

    Raises:
        ValueError: A hand is of another hand model.
    """
    others = sorted(set(records.hand_models) - {hand.name})
    if others:
        raise ValueError(
            f"The file has hands of the hand model {', '.join(others)}, and the page has {hand.name}. Start "
            f"it with hand={others[0]}."
        )
    mirrors = np.array([mirror_of("left" if one == "left" else "right") for one in records.sides])
    mirrors = mirrors.reshape(-1, 3)
    columns = (
        np.radians(records.joint_angles_degrees),
        records.shape,
        mirrors[:, :, None] * records.root_rotation * mirrors[:, None, :],
        records.translation * mirrors,
    )
    parameters = HandParameters(*(torch.from_numpy(one).float() for one in columns))
    vertices = hand.to_camera(parameters).vertices.double().numpy() * mirrors[:, None, :]
    return PosedRecords(records, vertices)
