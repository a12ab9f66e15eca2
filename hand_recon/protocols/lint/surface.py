"""Lint checks of the mesh against the landmarks and against the true vertices' order."""

import math
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import align_official
from hand_recon.evaluation.point_error import point_errors
from hand_recon.protocols.benchmarks import UNITS
from hand_recon.protocols.lint.axes import FLIPS, Signs
from hand_recon.protocols.lint.evidence import Hands, Suspicion, clearly_better, sizes
from hand_recon.protocols.lint.placement import ABOUT

APART: Final = 0.5
"""Largest mean distance of landmarks from the nearest vertex, over the mesh's size: 0.1 for hands, and
0.24 with errors of 40 mm on every coordinate of both."""

FLIP_GAIN: Final = 0.35
"""Least share of that distance that other axes remove."""

NO_CORRESPONDENCE: Final = (2.0, 0.01)
"""Largest vertex error in the right order: a factor of the landmark error, and an offset in metres."""


def apart(
    landmarks: Float[Tensor, "hand landmark=21 3"], mesh: Float[Tensor, "hand vertex 3"]
) -> Suspicion | None:
    """Check whether landmarks and vertices are in different units, axes or positions.

    Args:
        landmarks: The file's landmarks, converted from the protocol's conventions, metres.
        mesh: The vertices of the same frames, converted likewise, metres.
    """
    ratio = float((sizes(mesh) / sizes(landmarks)).median())
    if not math.isfinite(ratio) or ratio == 0:
        return None
    for factor in _unit_ratios():
        if abs(math.log(ratio * factor)) < math.log(ABOUT):
            return _mismatch(
                f"Your vertices are {ratio:.3g} times as large as your landmarks: the two look to be in "
                "different units",
                f"multiply the vertices by {factor:g}, or the landmarks by {1 / factor:g}",
                (landmarks, mesh, mesh * factor),
            )
    signs = _flip(landmarks, mesh)
    if signs is not None:
        negated = " and ".join(name for name, sign in zip("xyz", signs, strict=True) if sign < 0)
        return _mismatch(
            "Your landmarks and your vertices look to be in different axes",
            f"negate {negated} of one of them, as the protocol wants",
            (landmarks, mesh, _centred(mesh * mesh.new_tensor(signs), landmarks)),
        )
    now = _distance(landmarks, mesh)
    if float((now / sizes(mesh)).median()) <= APART:
        return None
    return Suspicion(
        "joints_and_vertices",
        f"Your landmarks are {1000 * float(now.mean()):.0f} mm from your mesh on average: the two have "
        "different origins. Aligned scores are right, because each is aligned without the other",
        confidence="note",
        measured=(1000 * float(now.mean()), None),
    )


def _mismatch(found: str, fix: str, points: tuple[Tensor, Tensor, Tensor]) -> Suspicion:
    landmarks, mesh, corrected = points
    distances = [1000 * float(_distance(landmarks, some).mean()) for some in (mesh, corrected)]
    return Suspicion(
        "joints_and_vertices",
        found,
        fix,
        score="distance from landmark to mesh",
        confidence="certain",
        measured=(distances[0], distances[1]),
    )


def _unit_ratios() -> list[float]:
    values = list(UNITS.values())
    return sorted({round(a / b, 6) for a in values for b in values} - {1.0})


def _flip(landmarks: Tensor, mesh: Tensor) -> Signs | None:
    now = _distance(landmarks, _centred(mesh, landmarks))
    distances = {
        signs: _distance(landmarks, _centred(mesh * mesh.new_tensor(signs), landmarks))
        for signs in FLIPS
    }
    signs = min(distances, key=lambda key: float(distances[key].mean()))
    return signs if clearly_better(now, distances[signs], FLIP_GAIN) else None


def _centred(mesh: Tensor, landmarks: Tensor) -> Tensor:
    """The mesh moved to the landmarks' centroid; the two centroids of a hand are at most 2 cm apart."""
    return mesh + landmarks.mean(dim=1, keepdim=True) - mesh.mean(dim=1, keepdim=True)


def _distance(landmarks: Tensor, mesh: Tensor) -> Float[Tensor, " hand"]:
    """Mean distance of each hand's landmarks to the nearest vertex."""
    return torch.cdist(landmarks, mesh).amin(dim=2).mean(dim=1)


def without_correspondence(
    hands: Hands, ground_truth: Float[Tensor, "hand vertex 3"], mesh: Float[Tensor, "hand vertex 3"]
) -> Suspicion | None:
    """Check whether the vertices are in another order than the ground truth's."""
    aligned = align_official(hands.ground_truth, hands.prediction)
    landmark_error = float(point_errors(hands.ground_truth, aligned).mean())
    error = float(point_errors(ground_truth, align_official(ground_truth, mesh)).mean())
    factor, offset = NO_CORRESPONDENCE
    if error <= factor * landmark_error + offset:
        return None
    return Suspicion(
        "vertex_order",
        f"Your vertices do not correspond to the ground truth's: E_V is {1000 * error:.1f} mm where E_J is "
        f"{1000 * landmark_error:.1f} mm. Write MANO's vertices in MANO's order",
        score="E_V",
        measured=(1000 * error, None),
    )
