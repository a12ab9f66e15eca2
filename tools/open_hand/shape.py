"""Ten shape directions of the hand, each scaled to its published variation (docs/open_hand.md).

Nine are strains of the hand's segments, blended by the skinning weights; the tenth is the largest variation
of the source's hands beyond these. Each is made orthogonal to the ones before it, so that independent
coefficients vary the hand as independently as possible.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import PARENTS, ROOT_JOINT
from open_hand.skeleton import ORDER, Skeleton
from open_hand.source import SourceHand

Strain = Callable[[str, int], Float[np.ndarray, " 3"]]
"""From a finger and its segment to its relative growth in length, depth and breadth."""


@dataclass(frozen=True)
class ShapeDirections:
    """Displacements per standard deviation, metres, relative to the middle MCP."""

    names: tuple[str, ...]
    """Names of the directions."""
    vertices: Float[np.ndarray, "vertex 3 direction=10"]
    """Displacements of the source mesh's vertices."""
    joints: Float[np.ndarray, "joint=16 3 direction=10"]
    """Displacements of the rotation centres."""


def _size(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    return np.full(3, 0.058)


def _finger_length(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    if finger == "palm":
        return np.array([-0.025, 0.0, 0.0])
    return np.array([0.028 if finger != "thumb" else 0.015, 0.0, 0.0])


def _finger_thickness(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    return (
        np.zeros(3)
        if finger == "palm" or (finger, part) == ("thumb", 0)
        else np.array([0, 0.055, 0.055])
    )


def _palm_breadth(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    return np.array([0, 0, 0.058]) if finger == "palm" else np.zeros(3)


def _thumb_length(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    return np.array([0.070, 0, 0]) if finger == "thumb" else np.zeros(3)


def _palm_thickness(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    if (finger, part) == ("thumb", 0):
        return np.array([0, 0.060, 0.060])
    return np.array([0, 0.070, 0]) if finger == "palm" else np.zeros(3)


def _index_to_ring(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    sign = {"index": 0.017, "ring": -0.017}.get(finger, 0.0)
    return np.array([sign, 0, 0])


def _little_finger(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    return np.array([0.045, 0, 0]) if finger == "little" else np.zeros(3)


def _taper(finger: str, part: int) -> Float[np.ndarray, " 3"]:
    if finger == "palm" or (finger, part) == ("thumb", 0):
        return np.zeros(3)
    steps = (0.030, 0.0, -0.050) if finger != "thumb" else (0.0, 0.030, -0.045)
    return np.array([0, steps[part], steps[part]])


STRAINS: dict[str, Strain] = {
    "size": _size,
    "finger length against palm length": _finger_length,
    "finger thickness": _finger_thickness,
    "palm breadth": _palm_breadth,
    "thumb length": _thumb_length,
    "palm and thenar thickness": _palm_thickness,
    "index against ring finger": _index_to_ring,
    "little finger length": _little_finger,
    "taper of the fingers": _taper,
}
"""The nine directions in order; the numbers are relative growth per standard deviation."""

REST_NAME = "build: remaining difference of the source's men and women, lean and muscular"

REST_RMS = 0.0005
"""Root mean square displacement of the tenth direction, metres."""


def shape_directions(
    source: SourceHand, skeleton: Skeleton, weights: Float[np.ndarray, "vertex joint=16"]
) -> ShapeDirections:
    """Compute the ten directions on the source mesh and its rotation centres."""
    fields = [
        _strain_field(source.vertices, skeleton, weights, strain) for strain in STRAINS.values()
    ]
    fields = _orthogonal(fields)
    fields.append(_rest_of_the_source(source, skeleton, weights, fields))
    stacked = np.stack(fields, axis=-1)
    count = len(source.vertices)
    return ShapeDirections((*STRAINS, REST_NAME), stacked[:count], stacked[count:])


def _strain_field(
    vertices: Float[np.ndarray, "vertex 3"],
    skeleton: Skeleton,
    weights: Float[np.ndarray, "vertex joint=16"],
    strain: Strain,
) -> Float[np.ndarray, "point 3"]:
    """Displacements of the vertices, then of the rotation centres, relative to the middle MCP."""
    growth = [np.diag(strain("palm", 0))]
    for joint in range(1, 16):
        finger, part = divmod(joint - 1, 3)
        frame = skeleton.frames[joint - 1]
        growth.append(frame @ np.diag(strain(ORDER[finger], part)) @ frame.T)
    centres = skeleton.joints
    translations = np.zeros((16, 3))
    for joint in range(1, 16):
        parent = PARENTS[joint]
        step = growth[parent] @ (centres[joint] - centres[parent])
        translations[joint] = translations[parent] + step
    offsets = vertices[:, None] - centres
    moved = np.einsum("jxy,vjy->vjx", np.stack(growth), offsets) + translations
    surface = np.einsum("vj,vjx->vx", weights, moved)
    return np.asarray(np.concatenate([surface, translations]) - translations[ROOT_JOINT])


def _orthogonal(fields: list[Float[np.ndarray, "point 3"]]) -> list[Float[np.ndarray, "point 3"]]:
    """Orthogonalize each field to the ones before it, on the vertices alone; joints follow."""
    result: list[Float[np.ndarray, "point 3"]] = []
    for field in fields:
        for earlier in result:
            inner = np.vdot(earlier[:-16], field[:-16]) / np.vdot(earlier[:-16], earlier[:-16])
            field = field - inner * earlier
        result.append(field)
    return result


def _rest_of_the_source(
    source: SourceHand,
    skeleton: Skeleton,
    weights: Float[np.ndarray, "vertex joint=16"],
    fields: list[Float[np.ndarray, "point 3"]],
) -> Float[np.ndarray, "point 3"]:
    """First principal direction of the source's hands after alignment and without the other nine."""
    aligned = [_aligned(variation, source.vertices) for variation in source.variations]
    carry = _joint_carriers(source, skeleton, weights)
    rests = []
    for hand in aligned:
        surface = hand - source.vertices
        field = np.concatenate([surface, carry @ surface])
        rests.append(_orthogonal([*fields, field - field[len(surface) + ROOT_JOINT]])[-1])
    centred = np.stack(rests) - np.mean(rests, axis=0)
    surfaces = centred[:, :-16].reshape(len(centred), -1)
    coefficients = np.linalg.svd(surfaces, full_matrices=False)[0][:, 0]
    first = np.einsum("n,npx->px", coefficients, centred)
    first *= np.sign(first[np.abs(first).sum(axis=1).argmax()].sum())
    first = _orthogonal([*fields, first])[-1]
    return np.asarray(first * REST_RMS / np.sqrt(np.square(first[:-16]).sum(axis=1).mean()))


def _aligned(
    points: Float[np.ndarray, "vertex 3"], target: Float[np.ndarray, "vertex 3"]
) -> Float[np.ndarray, "vertex 3"]:
    """Align points to a target by the similarity of least squares."""
    centre, goal = points.mean(axis=0), target.mean(axis=0)
    u, sizes, v = np.linalg.svd((points - centre).T @ (target - goal))
    scale = sizes.sum() / np.square(points - centre).sum()
    return np.asarray(scale * (points - centre) @ (u @ v) + goal)


def _joint_carriers(
    source: SourceHand, skeleton: Skeleton, weights: Float[np.ndarray, "vertex joint=16"]
) -> Float[np.ndarray, "joint=16 vertex"]:
    """Weights over the skin around each rotation centre, whose mean displacement the centre follows."""
    squared = np.square(skeleton.joints[:, None] - source.vertices).sum(axis=-1)
    near = np.exp(-squared / (2 * 0.012**2))
    for joint in range(1, 16):
        near[joint] *= weights[:, joint] + weights[:, PARENTS[joint]]
    return np.asarray(near / near.sum(axis=1, keepdims=True))
