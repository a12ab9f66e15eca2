"""Unit, landmark order and hand size of 3D landmarks that come without a description."""

from dataclasses import replace
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.landmarks.points_in_space import HAND, UNITS
from hand_recon.hand.landmark_order import better_order
from hand_recon.hand.skeleton import LANDMARK_ORDERS, landmark_permutation
from hand_recon.plausibility.given_hands import GivenHands, as_array, rows_by

MEAN_DIAGONAL: Final = 0.2
"""Diagonal of the box around an adult's hand, metres, that hands of unknown unit are given in the median."""


_PIXELS: Final = 20.0
"""Least extent of pixels; 3D points of this extent and less than 1 of depth are no hand."""


def without_placeholders(hands: GivenHands) -> GivenHands:
    """Take hands whose points are all one point, such as zeros, as missing.

    Args:
        hands: Hands in the units of their files.
    """
    points = hands.points
    alike = (points == points[:, :1]).flatten(1).all(dim=1) & ~hands.exact
    count = int(alike.sum())
    if not count:
        return hands
    note = f"All points of {count} of {len(hands)} hands are one point; these hands are missing."
    return hands.with_points(points.masked_fill(alike[:, None, None], torch.nan)).with_notes(note)


def in_metres(hands: GivenHands, order: str = "auto") -> GivenHands:
    """Convert landmarks to metres and the order of FreiHAND, file by file.

    Args:
        hands: Hands in the units and orders of their files.
        order: A key of `LANDMARK_ORDERS`, or `auto` to recognise it by the lengths of the bones.

    Raises:
        ValueError: The order is unknown, or the points are pixels with a confidence.
    """
    if order != "auto" and order not in LANDMARK_ORDERS:
        raise ValueError(
            f"order={order} is unknown; expected auto or one of {', '.join(sorted(LANDMARK_ORDERS))}."
        )
    points, notes = hands.points.clone(), []
    for file, rows in rows_by(hands.files).items():
        own = points[rows]
        # Files of hands and of MANO's parameters name unit and order.
        if any(hands.hand_models[row] for row in rows) or not own.isfinite().any():
            continue
        _refuse_pixels(own, file)
        factor, unit = metres_per_unit(own)
        if unit is None:
            notes.append(
                f"{file}: the unit of the points was not recognised; they are scaled to an adult's hand, and "
                "lengths in millimetres are relative to that."
            )
        elif unit != "metres":
            notes.append(f"{file}: the points are in {unit}.")
        found = better_order(as_array(own)) if order == "auto" else order
        if found not in (None, "freihand"):
            own = own[:, list(landmark_permutation(str(found), "freihand"))]
            notes.append(f"{file}: the landmarks are in the order {found}.")
        points[rows] = own * factor
    return replace(hands, points=points, notes=(*hands.notes, *notes))


def _refuse_pixels(points: Float[Tensor, "hand landmark=21 3"], file: str) -> None:
    """Refuse pixels with a confidence, whose third number is a share and hardly differs beside the others."""
    found = points[points.isfinite().all(dim=-1)]
    third = found[:, 2]
    size = (
        float((found[:, :2].amax(dim=0) - found[:, :2].amin(dim=0)).norm()) if len(found) else 0.0
    )
    if size > _PIXELS and float(third.min()) >= 0 and float(third.max()) <= 1:
        raise ValueError(
            f"{file} holds 2D landmarks in pixels with a confidence; expected 3D points. Fit them first: "
            f"hand-recon fit {file}, and audit the hands.json that it writes."
        )


def metres_per_unit(points: Float[Tensor, "hand landmark=21 3"]) -> tuple[float, str | None]:
    """Metres per unit of points by the size of hands, and the unit's name; None if no unit fits.

    Args:
        points: Any unit; NaN where missing.
    """
    present = points.isfinite().all(dim=-1, keepdim=True)
    high = torch.where(present, points, -torch.inf).amax(dim=1)
    low = torch.where(present, points, torch.inf).amin(dim=1)
    diagonals = (high - low).norm(dim=-1)
    diagonals = diagonals[diagonals.isfinite()]
    size = float(diagonals.median()) if len(diagonals) else 0.0
    for unit, metres in UNITS.items():
        if HAND[0] <= size * metres <= HAND[1]:
            return metres, unit
    return (MEAN_DIAGONAL / size if size > 0 else 1.0), None
