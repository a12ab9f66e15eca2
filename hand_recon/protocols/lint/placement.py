"""Lint checks of unit, and for points that are 2D, constant or without a position."""

import math
from dataclasses import replace
from typing import Final

import torch

from hand_recon.evaluation.alignment import WRIST
from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.protocols.benchmarks import UNITS, Protocol
from hand_recon.protocols.lint.evidence import (
    Hands,
    Suspicion,
    is_constant,
    size_ratio,
)

FLAT: Final = 0.03
"""Depth of a hand over its width, in the median frame, below which points are 2D."""

ABOUT: Final = 2.0
"""Factor within which a size counts as being in a unit."""

NEAR_ORIGIN: Final = 0.2
"""Distance from the camera within which no whole hand is visible, so that a position is missing, metres."""


def flat(hands: Hands) -> Suspicion | None:
    """Check for 2D points: a third coordinate with hardly any extent."""
    extent = hands.prediction.std(dim=1)
    width, depth = extent[:, :2].amax(dim=1).median(), extent[:, 2].median()
    if float(depth) >= FLAT * float(width):
        return None
    return Suspicion(
        "pixels",
        "Your third coordinate hardly varies within a hand, so that these look to be 2D pixel coordinates "
        f"(spread {float(width):.3g} across and {float(depth):.2g} in depth, read as metres). "
        "Write 3D points in the camera's frame",
        confidence="certain",
    )


def wrong_unit(hands: Hands, protocol: Protocol) -> tuple[Hands, Suspicion | None]:
    """Check whether the hands are in another unit."""
    ratio = size_ratio(hands.ground_truth, hands.prediction)
    for unit, metres in UNITS.items():
        factor = metres / UNITS[protocol.unit]
        if unit != protocol.unit and abs(math.log(ratio * factor)) < math.log(ABOUT):
            return replace(hands, prediction=hands.prediction * factor), Suspicion(
                "unit",
                f"Your points look to be in {unit}, and {protocol.name} wants {protocol.unit}",
                f"multiply them by {factor:g}",
                score="E_J_unaligned",
                confidence="certain",
            )
    if 1 / ABOUT < ratio < ABOUT:
        return hands, None
    # Not corrected: the positions may be right.
    return hands, Suspicion(
        "scale",
        f"Your hands are {ratio:.3g} times as large as the true ones, which is no unit. Only aligned "
        "scores are unaffected",
        score="MPJPE",
        confidence="note",
    )


def near_origin(hands: Hands) -> bool:
    """True if the predicted hands are around the camera while the true ones are in front of it."""
    true, predicted = (
        float(torch.linalg.vector_norm(points.mean(dim=1), dim=-1).median())
        for points in (hands.ground_truth, hands.prediction)
    )
    return predicted < NEAR_ORIGIN and true > 1.25 * NEAR_ORIGIN


def root_relative_note(hands: Hands) -> Suspicion | None:
    """Check for root-relative hands, whose positions are missing."""
    if not near_origin(hands):
        return None
    roots = {"wrist": WRIST, "middle finger's MCP": ROOT_LANDMARK}
    at_origin = [
        name
        for name, position in roots.items()
        if float(hands.prediction[:, position].abs().max()) < 1e-3
    ]
    origin = f"have the {at_origin[0]} at the origin" if at_origin else "are around the origin"
    return Suspicion(
        "root_relative",
        f"Your hands {origin} and not in front of the camera. Aligned and root-relative scores are right; "
        "unaligned ones need the root's position added",
        confidence="note",
        score="E_J_unaligned",
    )


def constant_note(hands: Hands) -> Suspicion | None:
    """Check for one constant hand in every frame."""
    if not is_constant(hands.prediction):
        return None
    return Suspicion(
        "constant",
        "Your predictions are the same hand in every frame, as of a mean pose. Only its aligned scores "
        "have a meaning",
        confidence="note",
    )
