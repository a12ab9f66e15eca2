"""Hands as the page receives them: JSON with the object of the file of hands, mesh, limits and changes."""

import base64
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.fitting.hands_file import hand_entries
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.ranges import RangeOfMotion
from hand_recon.page.changes import Change, changes
from hand_recon.page.closeness import limit_state
from hand_recon.page.row_fits import PosedRecords

BEYOND: Final = 1.0
"""Angle beyond a limit from which on it is told, degrees."""


def packed(values: np.ndarray, kind: str) -> str:
    """Numbers as base64 of little-endian bytes.

    Args:
        values: The numbers.
        kind: NumPy's name of their type, such as `<f4`.
    """
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")


def model_view(hand: HandModel) -> dict[str, Any]:
    """Triangles and skinning weights of a hand model; a weight of 255 is one."""
    return {
        "faces": packed(hand.faces.numpy(), "<u2"),
        "weights": packed((255 * hand.skinning_weights.numpy()).round(), "u1"),
        "vertices": len(hand.template),
        "joints": list(ARTICULATED),
    }


def hands_view(posed: PosedRecords, ranges: RangeOfMotion) -> list[dict[str, Any]]:
    """Hands of one row or frame, one object each; a hand without a result has no mesh.

    Args:
        posed: The hands.
        ranges: Ranges of motion, one set for all hands.
    """
    state = limit_state(posed.records.joint_angles_degrees, ranges)
    views = []
    for hand, entry in enumerate(hand_entries(posed.records)):
        view: dict[str, Any] = {"entry": entry}
        if posed.records.fitted[hand]:
            view["mesh"] = packed(posed.vertices[hand], "<f4")
            view["closeness"] = state.closeness[hand].round(3).tolist()
            view["beyond"] = _beyond(state.excess[hand])
        views.append(view)
    return views


def rows_view(found: Mapping[str, PosedRecords], ranges: RangeOfMotion) -> dict[str, Any]:
    """Hands of every row, each with its change from the row before and from the first row.

    Args:
        found: Hands by the row's key, in the order of the rows.
        ranges: Ranges of motion, one set for all hands.
    """
    rows: dict[str, Any] = {}
    all_rows = list(found.values())
    for place, (key, posed) in enumerate(found.items()):
        hands = hands_view(posed, ranges)
        for name, other in (("before", all_rows[max(place - 1, 0)]), ("first", all_rows[0])):
            for view, change in zip(hands, changes(other.records, posed.records), strict=True):
                view[f"change_from_{name}"] = _change_view(change)
        rows[key] = hands
    return rows


def _beyond(excess: Float[np.ndarray, "joint=15 axis=3"]) -> list[dict[str, Any]]:
    """Angles beyond their limits, the farthest first."""
    found = [
        {"joint": joint, "axis": axis, "degrees": round(float(excess[row, column]), 1)}
        for row, joint in enumerate(ARTICULATED)
        for column, axis in enumerate(AXES)
        if abs(excess[row, column]) >= BEYOND
    ]
    return sorted(found, key=lambda one: -abs(float(one["degrees"])))


def _change_view(change: Change | None) -> dict[str, Any] | None:
    if change is None:
        return None
    numbers = asdict(change)
    return {key: value if key == "joint" else round(value, 2) for key, value in numbers.items()}
