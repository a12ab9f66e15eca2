"""The hand's surface cut into closed parts: the palm and fourteen phalanges (Sec. 3.2, Eq. 4).

Skinning folds the skin where two neighbouring parts meet, so a surface may enter the next part of its own chain. Asking each part by
itself whether a point is inside tells such folds from penetrations (`docs/decisions.md`), and asks few triangles.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from torch import Tensor

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS

_THUMB_BASE: Final = JOINTS.index("thumb CMC")
PALM: Final = 0
"""The part of the wrist's joint, with the thumb's metacarpal, which lies in the same flesh."""
PARTS: Final[tuple[int, ...]] = tuple(j for j in range(len(JOINTS)) if j != _THUMB_BASE)
"""The joint that moves each part."""
_PART_OF_JOINT: Final = np.array([PALM if j == _THUMB_BASE else PARTS.index(j) for j in range(16)])
_DIGIT_OF_JOINT: Final = np.array([0, *(1 + j // 3 for j in range(15))])


_GROUP: Final = 32
"""Vertices that a group has at most."""


@dataclass(frozen=True)
class ClosedParts:
    """A hand's triangles by part, each part closed by fans over its openings, as neighbours share them."""

    faces: tuple[Int[np.ndarray, "face 3"], ...]
    """Triangles of each part, its fans last; corners count the vertices, then the fans' centres."""
    centres: Float[np.ndarray, "opening vertex"]
    """Weights of the vertices whose mean is the centre of each fan."""
    skin: Int[np.ndarray, "face 3"]
    """The hand's triangles."""
    palm_outline: Int[np.ndarray, "corner=3"]
    """Centres of the openings at the roots of the index and little finger and at the wrist, as `faces` counts."""
    part_of_face: Int[np.ndarray, " face"]
    """The part to which each of the hand's triangles belongs."""
    adjacent: Bool[np.ndarray, "part part"]
    """Which parts are the same or meet at a joint."""
    opponents: Bool[np.ndarray, "vertex part"]
    """Which parts a vertex can penetrate: neither its own nor one next to its own."""
    groups: Int[np.ndarray, "group member"]
    """Vertices of one part that are near each other at rest; a short group repeats its first member."""


def closed_parts(hand: HandModel) -> ClosedParts:
    """Cut a hand's surface into parts and close each.

    Raises:
        ValueError: The surface with its wrist cap is not closed, or a part of it cannot be closed.
    """
    faces, ring = hand.faces.cpu().numpy(), hand.wrist_ring.cpu().numpy()
    weights = hand.skinning_weights.cpu().numpy()
    part_of_face = _part_of_face(weights, faces)
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = {(a, b): int(part) for (a, b), part in zip(edges.tolist(), part_of_face.repeat(3), strict=True)}
    owner |= {(a, b): -1 for a, b in zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True)}
    openings = _openings(owner)
    count = len(weights)
    pairs = sorted({(min(pair), max(pair)) for pair in openings})
    centres = np.zeros((len(pairs), count))
    closed = [faces[part_of_face == part] for part in range(len(PARTS))]
    for row, pair in enumerate(pairs):
        rim = np.unique(openings[pair if pair in openings else pair[::-1]])
        centres[row, rim] = 1 / len(rim)
        for part in pair:
            if part >= 0:
                other = pair[0] + pair[1] - part
                fan = np.array([(b, a, count + row) for a, b in openings[part, other]])
                closed[part] = np.concatenate([closed[part], fan])
    roots = [PARTS.index(JOINTS.index(f"{finger} MCP")) for finger in ("index", "little")]
    outline = np.array([pairs.index(pair) for pair in ((PALM, roots[0]), (PALM, roots[1]), (-1, PALM))])
    adjacent = _adjacent()
    opponents = _opponents(faces, part_of_face, count, adjacent)
    groups = _vertex_groups(hand.template.cpu().numpy(), faces, part_of_face)
    return ClosedParts(tuple(closed), centres, faces, count + outline, part_of_face, adjacent, opponents, groups)


def _part_of_face(
    weights: Float[np.ndarray, "vertex joint=16"], faces: Int[np.ndarray, "face 3"]
) -> Int[np.ndarray, " face"]:
    """The part of the joint that carries most of a triangle; the palm's where two digits meet."""
    digits = np.sort(_DIGIT_OF_JOINT[weights.argmax(axis=1)][faces], axis=1)
    web = ((digits[:, :-1] > 0) & (digits[:, :-1] != digits[:, 1:])).any(axis=1)
    return np.where(web, PALM, _PART_OF_JOINT[weights[faces].sum(axis=1).argmax(axis=1)])


def _openings(owner: dict[tuple[int, int], int]) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Directed edges where each part meets each other one; the world beyond the wrist is part −1."""
    found: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (a, b), part in owner.items():
        other = owner.get((b, a))
        if other is None:
            raise ValueError(
                f"The hand's surface is open between vertices {a} and {b}: its faces and its wrist ring must "
                "close it, with triangles counter-clockwise from outside. Check the hand's asset."
            )
        if other != part:
            found.setdefault((part, other), []).append((a, b))
    for (part, other), rim in found.items():
        starts, ends = np.array(rim).T
        if not np.array_equal(np.sort(starts), np.sort(ends)):
            raise ValueError(
                f"The parts of {JOINTS[PARTS[part]]!r} and {JOINTS[PARTS[other]]!r} do not meet in closed loops, "
                "so neither can be closed. Check the skinning weights of the hand's asset."
            )
    return found


def _adjacent() -> Bool[np.ndarray, "part part"]:
    """Each part with itself, with the part that carries it and with those it carries."""
    parents = [_PART_OF_JOINT[max(PARENTS[joint], 0)] for joint in PARTS]
    adjacent = np.eye(len(PARTS), dtype=bool)
    adjacent[range(len(PARTS)), parents] = True
    return adjacent | adjacent.T


def _opponents(
    faces: Int[np.ndarray, "face 3"],
    part_of_face: Int[np.ndarray, " face"],
    count: int,
    adjacent: Bool[np.ndarray, "part part"],
) -> Bool[np.ndarray, "vertex part"]:
    """Parts that are two or more joints away from every part that a vertex belongs to."""
    member = np.zeros((count, len(PARTS)), dtype=bool)
    member[faces, part_of_face[:, None]] = True
    return ~(member @ adjacent)


def geodesic_distances(
    template: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex vertex"]:
    """Shortest ways along the edges of a surface at rest, metres; infinite between pieces of it."""
    start, end = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).T
    lengths = np.linalg.norm(template[start] - template[end], axis=1)
    # Both directions are written to the same place twice where two triangles share an edge: keep one.
    way = {(min(a, b), max(a, b)): length for a, b, length in zip(start.tolist(), end.tolist(), lengths, strict=True)}
    rows, columns = np.array(list(way)).T
    graph = csr_array((list(way.values()), (rows, columns)), shape=(len(template),) * 2)
    return dijkstra(graph, directed=False)


def _vertex_groups(
    template: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    part_of_face: Int[np.ndarray, " face"],
) -> Int[np.ndarray, "group member"]:
    """Each part's vertices, halved along their longest extent until no group is too large."""
    part = np.zeros(len(template), dtype=int)
    part[faces] = part_of_face[:, None]
    waiting = [np.flatnonzero(part == index) for index in range(len(PARTS))]
    groups = []
    while waiting:
        members = waiting.pop()
        if len(members) > _GROUP:
            longest = np.ptp(template[members], axis=0).argmax()
            ordered = members[template[members, longest].argsort()]
            waiting += np.array_split(ordered, 2)
        elif len(members):
            groups.append(np.append(members, np.repeat(members[:1], _GROUP - len(members))))
    return np.stack(groups)
