"""Lint checks of the axes of hands and of their positions, and for mirrored hands."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.evaluation.alignment import WRIST
from hand_recon.hand.skeleton import ROOT_LANDMARK
from hand_recon.protocols.benchmarks import Protocol
from hand_recon.protocols.lint.evidence import (
    Hands,
    Suspicion,
    certainty,
    clearly_better,
    is_constant,
    orientation_error,
    shape_error,
    size_ratio,
)
from hand_recon.protocols.lint.placement import ABOUT, near_origin

AXES_GAIN: Final = 0.3
"""Least share of the orientation error that other axes remove."""

FLOOR: Final = 0.002
"""Largest orientation error in the right axes, in addition to twice the shape error, metres."""

MIRRORED_SHARE: Final = 0.05
"""Least share of mirrored hands; fewer may be errors of the method."""

Signs = tuple[float, float, float]

NO_FLIP: Final[Signs] = (1, 1, 1)
"""The protocol's own axes."""

FLIPS: Final[dict[Signs, str]] = {
    (1, -1, -1): "OpenGL's axes (y up, z backward)",
    (1, 1, -1): "axes whose depth z is negated",
    (-1, 1, 1): "axes whose x is negated, as of a mirrored image or of a left hand",
    (1, -1, 1): "axes whose y is negated",
    (-1, -1, 1): "axes whose x and y are negated",
    (-1, 1, -1): "axes whose x and z are negated",
    (-1, -1, -1): "axes that are all negated",
}
"""Descriptions of other signs of the axes, for a protocol with OpenCV's axes."""


def wrong_axes(hands: Hands, protocol: Protocol) -> tuple[Hands, Suspicion | None]:
    """Check whether other signs of the axes fit the orientation and position of the hands better."""
    unmirrored = shape_error(hands.ground_truth, hands.prediction)
    mirrored = shape_error(hands.ground_truth, _flipped(hands.prediction, (-1, 1, 1)))
    signs = _axis_signs(hands, unmirrored, mirrored)
    if signs is None:
        return _mirrored(hands, unmirrored, mirrored)
    if signs == NO_FLIP:
        return _wrong_position(hands)
    flipped = replace(hands, prediction=_flipped(hands.prediction, signs))
    now, corrected = (
        orientation_error(hands.ground_truth, some.prediction) for some in (hands, flipped)
    )
    kind = "mirrored" if math.prod(signs) < 0 else "axes"
    about = _about_the_root(hands, flipped)
    where = " about a root that is at the right place" if about is not None else ""
    corrected_hands = flipped if about is None else about
    axes = _in_the_files_axes(signs, protocol)
    return corrected_hands, Suspicion(
        kind,
        f"Your hands look to be in {axes}{where}. Alignment hides it",
        f"negate {_coordinates(signs)}{' of the hand relative to its root' if where else ''}",
        score=_visible_score(
            corrected_hands, "E_J_proper" if kind == "mirrored" else "E_J_unaligned"
        ),
        confidence=certainty(now, corrected),
    )


def _axis_signs(hands: Hands, unmirrored: Tensor, mirrored: Tensor) -> Signs | None:
    """Signs that give the right orientation; `NO_FLIP` for the file's own axes, none if no signs do."""
    if is_constant(hands.prediction):
        return None
    now = orientation_error(hands.ground_truth, hands.prediction)
    errors = {
        signs: orientation_error(hands.ground_truth, _flipped(hands.prediction, signs))
        for signs in FLIPS
    }
    signs = min(errors, key=lambda key: float(errors[key].mean()))
    shape, other = (mirrored, unmirrored) if math.prod(signs) < 0 else (unmirrored, mirrored)
    # Orientations that hardly vary may fit other hands by chance; then their shape does not fit.
    possible = float(shape.mean()) < 1.1 * float(other.mean())
    fits = possible and float(errors[signs].mean()) < 2 * float(shape.mean()) + FLOOR
    if fits and clearly_better(now, errors[signs], AXES_GAIN):
        return signs
    return None if clearly_better(unmirrored, mirrored, AXES_GAIN) else NO_FLIP


def _mirrored(hands: Hands, unmirrored: Tensor, mirrored: Tensor) -> tuple[Hands, Suspicion | None]:
    """Check for mirrored hands whose axes are unknown because their orientation does not fit either."""
    if not clearly_better(unmirrored, mirrored, AXES_GAIN):
        return hands, None
    return replace(hands, prediction=_flipped(hands.prediction, (-1, 1, 1))), Suspicion(
        "mirrored",
        "Your hands look to be mirror images: left hands for right ones, or one axis negated. The official "
        "alignment hides it",
        "mirror them, for example by negating x",
        score="E_J_proper",
        confidence=certainty(unmirrored, mirrored),
    )


def _about_the_root(hands: Hands, flipped: Hands) -> Hands | None:
    """The flipped hands at their former wrist positions, if only those are right."""
    if near_origin(hands):
        return None
    moved = flipped.prediction + (hands.prediction - flipped.prediction)[:, WRIST, None]
    stays = _distance(hands.ground_truth, moved)
    return Hands(hands.ground_truth, moved) if _closer(_distance(*_both(flipped)), stays) else None


def _wrong_position(hands: Hands) -> tuple[Hands, Suspicion | None]:
    """Check for positions in other axes or another unit than the hands themselves."""
    in_its_unit = 1 / ABOUT < size_ratio(hands.ground_truth, hands.prediction) < ABOUT
    if near_origin(hands) or not in_its_unit:
        return hands, None
    now = _distance(*_both(hands))
    best: tuple[Tensor, str] | None = None
    for moved, fix in _other_positions(hands.prediction):
        nearer = (
            best is None
            or _distance(hands.ground_truth, moved).mean()
            < _distance(hands.ground_truth, best[0]).mean()
        )
        best = (moved, fix) if nearer else best
    if best is None or not _closer(now, _distance(hands.ground_truth, best[0])):
        return hands, None
    return Hands(hands.ground_truth, best[0]), Suspicion(
        "position",
        "Your hands have the right orientation and size, but their positions have other axes or another unit",
        f"{best[1]} in each hand's position alone",
        score="E_J_unaligned",
    )


def _other_positions(prediction: Tensor) -> Iterator[tuple[Tensor, str]]:
    """The hands with their positions in other units and axes, and the fix that leads there."""
    for root, factor, signs in product(
        (WRIST, ROOT_LANDMARK), (1.0, 0.01, 0.001), (NO_FLIP, *FLIPS)
    ):
        position = prediction[:, root, None]
        steps = [
            "" if factor == 1 else f"multiply by {factor:g}",
            "" if signs == NO_FLIP else f"negate {_coordinates(signs)}",
        ]
        moved = prediction + _flipped(position, signs) * factor - position
        yield moved, " and ".join(step for step in steps if step)


def _closer(now: Tensor, corrected: Tensor) -> bool:
    return clearly_better(now, corrected, 0.65) and float(corrected.mean()) < 0.15


def _both(hands: Hands) -> tuple[Tensor, Tensor]:
    return hands.ground_truth, hands.prediction


def _distance(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    return torch.linalg.vector_norm(ground_truth.mean(dim=1) - prediction.mean(dim=1), dim=-1)


def some_mirrored(hands: Hands) -> tuple[Hands, Suspicion | None]:
    """Check for some mirrored hands: left hands that were not mirrored back."""
    if is_constant(hands.prediction):
        return hands, None
    flipped = _flipped(hands.prediction, (-1, 1, 1))
    now, corrected = (
        orientation_error(hands.ground_truth, points) for points in (hands.prediction, flipped)
    )
    wrong = (corrected < 0.5 * now) & (now > 0.01)
    if not max(2, MIRRORED_SHARE * len(now)) <= int(wrong.sum()) < 0.95 * len(now):
        return hands, None
    unmirrored = shape_error(hands.ground_truth[wrong], hands.prediction[wrong])
    if float(shape_error(hands.ground_truth[wrong], flipped[wrong]).mean()) > 0.7 * float(
        unmirrored.mean()
    ):
        return hands, None
    points = torch.where(wrong[:, None, None], flipped, hands.prediction)
    return Hands(hands.ground_truth, points), Suspicion(
        "some_mirrored",
        f"{100 * float(wrong.double().mean()):.0f} % of your hands look to be mirrored: left hands that were "
        "predicted as right ones. The official alignment hides it",
        "mirror these back by negating x",
        score="E_J_proper",
        confidence="certain",
    )


def _visible_score(hands: Hands, score: str) -> str:
    return "MPJPE" if score == "E_J_unaligned" and near_origin(hands) else score


def _flipped(points: Float[Tensor, "hand point 3"], signs: Signs) -> Float[Tensor, "hand point 3"]:
    return points * points.new_tensor(signs)


def _coordinates(signs: Signs) -> str:
    return " and ".join(name for name, sign in zip("xyz", signs, strict=True) if sign < 0)


def _in_the_files_axes(signs: Signs, protocol: Protocol) -> str:
    if protocol.axes == "OpenGL" and signs == (1, -1, -1):
        return "OpenCV's axes (y down, z forward)"
    return FLIPS[signs]
