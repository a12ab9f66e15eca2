"""Segmentation of the hand's surface into closed parts: palm and fourteen phalanges (Sec. 3.2, Eq. 4).

Skinning folds the skin where two parts meet, and a fold is not a penetration. An inside test per part tells
the two apart (decision 35) and needs few triangles.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import JOINTS, PARENTS

_THUMB_BASE: Final = JOINTS.index("thumb CMC")
PARTS: Final[tuple[int, ...]] = tuple(j for j in range(len(JOINTS)) if j != _THUMB_BASE)
"""Index of the joint that moves each part."""
PALM_PART: Final = 0
"""Index of the palm, which includes the thumb's metacarpal."""
_BEYOND: Final = -1
"""Number that stands for the forearm beyond the wrist."""
_PART_OF_JOINT: Final = np.array(
    [PALM_PART if joint == _THUMB_BASE else PARTS.index(joint) for joint in range(len(JOINTS))]
)
_PARENTS: Final = np.array([_PART_OF_JOINT[max(PARENTS[joint], 0)] for joint in PARTS])
"""Index of each part's parent; the palm's is itself."""
_DEPTHS: Final = np.array([0, *(1 + k for _ in range(4) for k in range(3)), 1, 2])
"""Number of joints between each part and the palm."""
_OUTLINE: Final = (
    (PALM_PART, PARTS.index(JOINTS.index("index MCP"))),
    (PALM_PART, PARTS.index(JOINTS.index("little MCP"))),
    (_BEYOND, PALM_PART),
)
_GROUP: Final = 32
"""Largest number of vertices in a group."""

Rims = dict[tuple[int, int], list[tuple[int, int]]]


@dataclass(frozen=True)
class ClosedParts:
    """The hand's triangles by part; fans of triangles, shared by adjacent parts, close the openings."""

    faces: tuple[Int[np.ndarray, "_ 3"], ...]
    """Triangles of each part, its fans last; corners count the vertices, then the fans' centres."""
    centres: Float[np.ndarray, "opening vertex"]
    """Weight of every vertex in the centre of each fan, the mean of the opening's vertices."""
    palm_outline: Int[np.ndarray, "corner=3"]
    """Fan centres at the index MCP, little MCP and wrist, numbered as in `faces`."""
    skin: Int[np.ndarray, "face 3"]
    """Triangles of the hand's surface, without fans."""
    part_of_face: Int[np.ndarray, " face"]
    """Part of each triangle in `skin`."""
    adjacent: Bool[np.ndarray, "part part"]
    """Pairs of parts that are the same or meet at a joint."""
    opponents: Bool[np.ndarray, "vertex part"]
    """Parts that each vertex can penetrate: neither its own nor one adjacent to its own."""
    groups: Int[np.ndarray, "group member"]
    """Groups of neighbouring vertices of one part; a short group repeats its first member."""


def closed_parts(hand: HandModel) -> ClosedParts:
    """Cut a hand's surface into parts and close each of them.

    Args:
        hand: The hand model.

    Raises:
        ValueError: The surface with its wrist cap is not closed.
    """
    skin, ring = hand.faces.cpu().numpy(), hand.wrist_ring.cpu().numpy()
    weights, template = hand.skinning_weights.cpu().numpy(), hand.template.cpu().numpy()
    adjacent = _adjacent()
    part_of_face = _part_of_face(weights, skin, adjacent)
    rims = _rims(skin, ring, part_of_face)
    openings = sorted(pair for pair in rims if pair[0] < pair[1])
    count = len(template)
    centres = np.zeros((len(openings), count))
    faces = [skin[part_of_face == part] for part in range(len(PARTS))]
    for row, (part, other) in enumerate(openings):
        vertices = np.unique(rims[other, part])
        centres[row, vertices] = 1 / len(vertices)
        for one, another in ((part, other), (other, part)):
            if one != _BEYOND:
                fan = np.array([(b, a, count + row) for a, b in rims[one, another]])
                faces[one] = np.concatenate([faces[one], fan])
    return ClosedParts(
        faces=tuple(faces),
        centres=centres,
        palm_outline=count + np.array([openings.index(pair) for pair in _OUTLINE]),
        skin=skin,
        part_of_face=part_of_face,
        adjacent=adjacent,
        opponents=~(_membership(skin, part_of_face) @ adjacent),
        groups=_vertex_groups(template, skin, part_of_face),
    )


def _part_of_face(
    weights: Float[np.ndarray, "vertex joint=16"],
    faces: Int[np.ndarray, "face 3"],
    adjacent: Bool[np.ndarray, "part part"],
) -> Int[np.ndarray, " face"]:
    """Part of each triangle by largest skinning weight, changed so that only adjacent parts meet.

    Where other parts share an edge, such as two fingers in a web, the triangle farther from the palm passes
    to its parent part. Consecutive parts around a vertex are then neighbours in the tree of bones, so that
    two parts meet in closed loops.
    """
    part = _PART_OF_JOINT[weights[faces].sum(axis=1).argmax(axis=1)]
    neighbours = _neighbours(faces)
    while True:
        pairs = neighbours[~adjacent[tuple(part[neighbours].T)]]
        if not len(pairs):
            return part
        depths = _DEPTHS[part[pairs]]
        passing = np.unique(pairs[depths == depths.max(axis=1, keepdims=True)])
        part[passing] = _PARENTS[part[passing]]


def _neighbours(faces: Int[np.ndarray, "face 3"]) -> Int[np.ndarray, "edge 2"]:
    """Pairs of triangles that share an edge."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    return np.stack([order[1:][same], order[:-1][same]], axis=1) // 3


def _membership(
    faces: Int[np.ndarray, "face 3"], part_of_face: Int[np.ndarray, " face"]
) -> Bool[np.ndarray, "vertex part"]:
    """Parts that have a triangle at each vertex."""
    member = np.zeros((faces.max() + 1, len(PARTS)), dtype=bool)
    member[faces, part_of_face[:, None]] = True
    return member


def _rims(
    faces: Int[np.ndarray, "face 3"],
    ring: Int[np.ndarray, " ring"],
    part_of_face: Int[np.ndarray, " face"],
) -> Rims:
    """Edges of each part where it meets another, keyed by the two parts, in the direction of its triangles.

    Raises:
        ValueError: The surface is not closed.
    """
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    owner = dict(zip(map(tuple, edges), part_of_face.repeat(3).tolist(), strict=True))
    owner |= dict.fromkeys(zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True), _BEYOND)
    twice = len(edges) + len(ring) - len(owner)
    single = [edge for edge in owner if edge[::-1] not in owner]
    if twice or single:
        raise ValueError(
            f"The hand's faces and its wrist ring must close the surface, with triangles counter-clockwise "
            f"from outside; found {len(single)} edges with one side and {twice} with more than two. "
            "Check the hand's asset."
        )
    rims: Rims = {}
    for edge, part in owner.items():
        if owner[edge[::-1]] != part:
            rims.setdefault((part, owner[edge[::-1]]), []).append(edge)
    return rims


def _adjacent() -> Bool[np.ndarray, "part part"]:
    """Each part with itself, its parent and its children."""
    adjacent = np.eye(len(PARTS), dtype=bool)
    adjacent[range(len(PARTS)), _PARENTS] = True
    return adjacent | adjacent.T


def geodesic_distances(
    template: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Float[np.ndarray, "vertex vertex"]:
    """Geodesic distances of vertices along edges at rest, metres; infinite between separate pieces."""
    start, end = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).T
    lengths = np.linalg.norm(template[start] - template[end], axis=1)
    graph = csr_array((lengths, (start, end)), shape=(len(template), len(template)))
    return dijkstra(graph, directed=False)


def _vertex_groups(
    template: Float[np.ndarray, "vertex 3"],
    faces: Int[np.ndarray, "face 3"],
    part_of_face: Int[np.ndarray, " face"],
) -> Int[np.ndarray, "group member"]:
    """Vertices of each part, halved along their longest extent until no group is too large."""
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
