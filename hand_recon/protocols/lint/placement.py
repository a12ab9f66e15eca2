"""Are the hands in another unit, in other axes, mirrored, at another place, or not in space at all?"""

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
from hand_recon.protocols.benchmarks import UNITS, Protocol
from hand_recon.protocols.lint.evidence import (
    Hands,
    Suspicion,
    certainty,
    clearly_better,
    is_constant,
    shape_error,
    size_ratio,
    turned_error,
)

FLAT: Final = 0.03
"""Depth of a hand over its width, in the median frame: no hand is so thin in most frames."""

ABOUT: Final = 2.0
"""Within this factor of a unit, a size is in that unit."""

AXES_GAIN: Final = 0.3
"""Least share of the error of turned hands that other axes take away."""

FLOOR: Final = 0.002
"""Metres, beside twice the error of the shape: what hands in the right axes stay below."""

NEAR_ORIGIN: Final = 0.2
"""Metres from the camera within which no whole hand can be seen: a position is missing."""

MIRRORED_SHARE: Final = 0.05
"""Of the frames: fewer mirrored hands than these may be the method's own."""

Signs = tuple[float, float, float]

NO_FLIP: Final[Signs] = (1, 1, 1)
"""The protocol's own axes."""

FLIPS: Final[dict[Signs, str]] = {
    (1, -1, -1): "OpenGL's axes (y up, z backward)",
    (1, 1, -1): "axes whose depth z is negated",
    (-1, 1, 1): "axes whose x is negated, as of a mirrored picture or of a left hand",
    (1, -1, 1): "axes whose y is negated",
    (-1, -1, 1): "axes whose x and y are negated",
    (-1, 1, -1): "axes whose x and z are negated",
    (-1, -1, -1): "axes that are all negated",
}
"""What signs other than the protocol's would mean, where the protocol has OpenCV's axes."""


def flat(hands: Hands) -> Suspicion | None:
    """Has the third coordinate next to no extent: pixels, or a projection?"""
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
    """Is a hand a hundred or a thousand times too large or too small?"""
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
    # Nothing is mended: where the hands are may be right.
    return hands, Suspicion(
        "scale",
        f"Your hands are {ratio:.3g} times as large as the true ones, which is no unit. Aligned scores do "
        "not see it, the others do",
        score="MPJPE",
        confidence="note",
    )


def wrong_axes(hands: Hands, protocol: Protocol) -> tuple[Hands, Suspicion | None]:
    """Read the hands, and where they are, with all signs of the axes."""
    plain = shape_error(hands.ground_truth, hands.prediction)
    mirrored = shape_error(hands.ground_truth, _flipped(hands.prediction, (-1, 1, 1)))
    signs = _turn(hands, plain, mirrored)
    if signs is None:
        return _mirrored(hands, plain, mirrored)
    if signs == NO_FLIP:
        return _misplaced(hands)
    flipped = replace(hands, prediction=_flipped(hands.prediction, signs))
    now, mended = (turned_error(hands.ground_truth, some.prediction) for some in (hands, flipped))
    kind = "mirrored" if math.prod(signs) < 0 else "axes"
    about = _about_the_root(hands, flipped)
    where = " about a root that is at the right place" if about is not None else ""
    mended_hands = flipped if about is None else about
    axes = _in_the_files_axes(signs, protocol)
    return mended_hands, Suspicion(
        kind,
        f"Your hands look to be in {axes}{where}. Alignment hides it",
        f"negate {_coordinates(signs)}{' of the hand relative to its root' if where else ''}",
        score=_visible_score(mended_hands, "E_J_proper" if kind == "mirrored" else "E_J_unaligned"),
        confidence=certainty(now, mended),
    )


def _turn(hands: Hands, plain: Tensor, mirrored: Tensor) -> Signs | None:
    """The signs that turn the hands as they should be, one's own where those do; none if no signs do."""
    if is_constant(hands.prediction):
        return None
    now = turned_error(hands.ground_truth, hands.prediction)
    errors = {
        signs: turned_error(hands.ground_truth, _flipped(hands.prediction, signs))
        for signs in FLIPS
    }
    signs = min(errors, key=lambda key: float(errors[key].mean()))
    shape, other = (mirrored, plain) if math.prod(signs) < 0 else (plain, mirrored)
    # Hands that are turned nearly alike may be nearer to some others turned round: not in their form.
    possible = float(shape.mean()) < 1.1 * float(other.mean())
    fits = possible and float(errors[signs].mean()) < 2 * float(shape.mean()) + FLOOR
    if fits and clearly_better(now, errors[signs], AXES_GAIN):
        return signs
    return None if clearly_better(plain, mirrored, AXES_GAIN) else NO_FLIP


def _mirrored(hands: Hands, plain: Tensor, mirrored: Tensor) -> tuple[Hands, Suspicion | None]:
    """A mirrored form whose axes cannot be told, because the hands are turned otherwise."""
    if not clearly_better(plain, mirrored, AXES_GAIN):
        return hands, None
    return replace(hands, prediction=_flipped(hands.prediction, (-1, 1, 1))), Suspicion(
        "mirrored",
        "Your hands look to be mirror images: left hands for right ones, or one axis negated. The official "
        "alignment hides it",
        "mirror them, for example by negating x",
        score="E_J_proper",
        confidence=certainty(plain, mirrored),
    )


def _about_the_root(hands: Hands, flipped: Hands) -> Hands | None:
    """The flipped hands where their wrists were, if these were right before and are not after."""
    if near_origin(hands):
        return None
    moved = flipped.prediction + (hands.prediction - flipped.prediction)[:, WRIST, None]
    stays = _distance(hands.ground_truth, moved)
    return Hands(hands.ground_truth, moved) if _closer(_distance(*_both(flipped)), stays) else None


def _misplaced(hands: Hands) -> tuple[Hands, Suspicion | None]:
    """Hands that are right, at a place whose axes or unit are not."""
    in_its_unit = 1 / ABOUT < size_ratio(hands.ground_truth, hands.prediction) < ABOUT
    if near_origin(hands) or not in_its_unit:
        return hands, None
    now = _distance(*_both(hands))
    best: tuple[Tensor, str] | None = None
    for moved, cure in _other_places(hands.prediction):
        nearer = (
            best is None
            or _distance(hands.ground_truth, moved).mean()
            < _distance(hands.ground_truth, best[0]).mean()
        )
        best = (moved, cure) if nearer else best
    if best is None or not _closer(now, _distance(hands.ground_truth, best[0])):
        return hands, None
    return Hands(hands.ground_truth, best[0]), Suspicion(
        "position",
        "Your hands are turned and sized as they should be, but are placed in other axes or another unit",
        f"{best[1]} in each hand's position alone",
        score="E_J_unaligned",
    )


def _other_places(prediction: Tensor) -> Iterator[tuple[Tensor, str]]:
    """The hands where their roots would be in other units and axes, and how to bring them there."""
    for root, factor, signs in product(
        (WRIST, ROOT_LANDMARK), (1.0, 0.01, 0.001), (NO_FLIP, *FLIPS)
    ):
        place = prediction[:, root, None]
        steps = [
            "" if factor == 1 else f"multiply by {factor:g}",
            "" if signs == NO_FLIP else f"negate {_coordinates(signs)}",
        ]
        moved = prediction + _flipped(place, signs) * factor - place
        yield moved, " and ".join(step for step in steps if step)


def _closer(now: Tensor, mended: Tensor) -> bool:
    return clearly_better(now, mended, 0.65) and float(mended.mean()) < 0.15


def _both(hands: Hands) -> tuple[Tensor, Tensor]:
    return hands.ground_truth, hands.prediction


def _distance(ground_truth: Tensor, prediction: Tensor) -> Tensor:
    return torch.linalg.vector_norm(ground_truth.mean(dim=1) - prediction.mean(dim=1), dim=-1)


def near_origin(hands: Hands) -> bool:
    """Whether the predicted hands surround the camera where the true ones are before it."""
    true, predicted = (
        float(torch.linalg.vector_norm(points.mean(dim=1), dim=-1).median())
        for points in _both(hands)
    )
    return predicted < NEAR_ORIGIN and true > 1.25 * NEAR_ORIGIN


def root_relative_note(hands: Hands) -> Suspicion | None:
    """Are the hands around the origin: is their position missing?"""
    if not near_origin(hands):
        return None
    roots = {"wrist": WRIST, "middle finger's MCP": ROOT_LANDMARK}
    at_origin = [
        name
        for name, place in roots.items()
        if float(hands.prediction[:, place].abs().max()) < 1e-3
    ]
    origin = f"have the {at_origin[0]} at the origin" if at_origin else "are around the origin"
    return Suspicion(
        "root_relative",
        f"Your hands {origin} and not before the camera. Aligned and root-relative scores are right; "
        "unaligned ones need the root's position added",
        confidence="note",
        score="E_J_unaligned",
    )


def some_mirrored(hands: Hands) -> tuple[Hands, Suspicion | None]:
    """Are some of the hands mirrored: left hands that were not mirrored back?"""
    if is_constant(hands.prediction):
        return hands, None
    flipped = _flipped(hands.prediction, (-1, 1, 1))
    now, mended = (
        turned_error(hands.ground_truth, points) for points in (hands.prediction, flipped)
    )
    wrong = (mended < 0.5 * now) & (now > 0.01)
    if not max(2, MIRRORED_SHARE * len(now)) <= int(wrong.sum()) < 0.95 * len(now):
        return hands, None
    plain = shape_error(hands.ground_truth[wrong], hands.prediction[wrong])
    if float(shape_error(hands.ground_truth[wrong], flipped[wrong]).mean()) > 0.7 * float(
        plain.mean()
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


def constant_note(hands: Hands) -> Suspicion | None:
    """Is one hand predicted for every frame?"""
    if not is_constant(hands.prediction):
        return None
    return Suspicion(
        "constant",
        "Your predictions are one and the same hand in every frame, as of a mean pose. Only aligned scores "
        "mean something for it",
        confidence="note",
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
