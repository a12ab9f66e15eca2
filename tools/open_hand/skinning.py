"""Skinning weights around the anatomical centres: each joint blends over the finger's own thickness."""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from scipy.sparse.linalg import spsolve

from open_hand.skeleton import ORDER, SOURCE_ROW, Skeleton, unit
from open_hand.source import SourceHand

HALF_WIDTH = {"MCP": 0.0125, "PIP": 0.0065, "DIP": 0.0050}
"""Half of the stretch of skin over which a joint's turn is taken up, metres."""

PALMAR_LAG = {"MCP": 0.55, "PIP": 0.0, "DIP": 0.0}
"""How much farther distal the palm's skin starts to move per metre of depth below the centre.

The palm reaches 2 cm beyond the MCP centres, the skin of the knuckles none.
"""

RAY_WIDTH = 0.0060
"""Softness of the border between neighbouring rays in the palm, metres."""

SMOOTHING_STEPS = 4


def skinning_weights(
    source: SourceHand, skeleton: Skeleton
) -> Float[np.ndarray, "vertex joint=16"]:
    """How much each joint carries each vertex; no finger's skin follows another finger."""
    vertices = source.vertices
    neighbours = _neighbour_average(source.faces, len(vertices))
    owner = _owners(source)
    thumb = _thumb_share(source, skeleton)
    rays = _ray_shares(source, skeleton, neighbours, owner)
    weights = np.zeros((len(vertices), 16))
    for position, finger in enumerate(ORDER):
        first = 1 + 3 * position
        if finger == "thumb":
            share = thumb
            turns = [np.ones(len(vertices))]
        else:
            share = rays[:, position] * (1 - thumb)
            turns = [_turn(vertices, skeleton, first, "MCP")]
        turns += [
            _turn(vertices, skeleton, first + 1, "PIP"),
            _turn(vertices, skeleton, first + 2, "DIP"),
        ]
        carried = share * turns[0]
        weights[:, first] = carried * (1 - turns[1])
        weights[:, first + 1] = carried * turns[1] * (1 - turns[2])
        weights[:, first + 2] = carried * turns[1] * turns[2]
    weights[:, 0] = 1 - weights.sum(axis=1)
    weights = weights.clip(min=0)
    for _ in range(SMOOTHING_STEPS):
        weights = 0.5 * weights + 0.5 * (neighbours @ weights)
        weights = _keep_apart(weights, owner)
    return weights


def _owners(source: SourceHand) -> Int[np.ndarray, " vertex"]:
    """The finger, in MANO's order, that alone may move a vertex; −1 in the palm and the webs."""
    owner = np.full(len(source.vertices), -1)
    for position, finger in enumerate(ORDER):
        owner[source.finger_weights[:, SOURCE_ROW[finger]] > 0.98] = position
    return owner


def _keep_apart(
    weights: Float[np.ndarray, "vertex joint=16"], owner: Int[np.ndarray, " vertex"]
) -> Float[np.ndarray, "vertex joint=16"]:
    """Free each finger's skin of the other fingers' joints, four influences at most, rows to one."""
    finger = np.concatenate([[-1], np.repeat(np.arange(5), 3)])
    foreign = (owner[:, None] >= 0) & (finger[None] >= 0) & (finger[None] != owner[:, None])
    weights = np.where(foreign, 0.0, weights)
    weakest = np.sort(weights, axis=1)[:, -4, None]
    weights = np.where((weights < weakest) | (weights < 1e-4), 0.0, weights)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _turn(
    vertices: Float[np.ndarray, "vertex 3"], skeleton: Skeleton, joint: int, kind: str
) -> Float[np.ndarray, " vertex"]:
    """0 before the joint, 1 beyond it, with a smooth step along the bisector of its two bones."""
    centre = skeleton.joints[joint]
    before = centre - skeleton.joints[0 if kind == "MCP" else joint - 1]
    after = np.diff(skeleton.bone(joint), axis=0)[0]
    along = unit(unit(before) + unit(after))
    dorsal = skeleton.frames[joint - 1][:, 1]
    dorsal = unit(dorsal - dorsal @ along * along)
    offset = vertices - centre
    depth = (-offset @ dorsal).clip(min=0)
    return _smooth_step((offset @ along - PALMAR_LAG[kind] * depth) / HALF_WIDTH[kind])


def _smooth_step(position: Float[np.ndarray, " vertex"]) -> Float[np.ndarray, " vertex"]:
    """From 0 at −1 to 1 at +1 with flat ends."""
    t = (0.5 * (position + 1)).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _ray_shares(
    source: SourceHand,
    skeleton: Skeleton,
    neighbours: sparse.csr_matrix,
    owner: Int[np.ndarray, " vertex"],
) -> Float[np.ndarray, "vertex finger=4"]:
    """To which of the four fingers' rays a vertex belongs, seen from the back of the hand."""
    seen = source.vertices[:, [0, 2]]
    distances = []
    for position, finger in enumerate(ORDER[:4]):
        base = source.metacarpal_bases[SOURCE_ROW[finger]]
        points = np.stack([base, *skeleton.joints[1 + 3 * position : 3 + 3 * position]])[:, [0, 2]]
        pieces = [_distance(seen, points[i], points[i + 1]) for i in range(2)]
        distances.append(np.minimum(*pieces))
    squared = np.square(np.stack(distances, axis=1) / RAY_WIDTH) / 2
    shares = np.exp(-(squared - squared.min(axis=1, keepdims=True)))
    shares /= shares.sum(axis=1, keepdims=True)
    own = np.eye(5)[owner][:, :4]
    fixed = (owner >= 0)[:, None]
    shares = np.where(fixed, own, shares)
    for _ in range(5):
        shares = np.where(fixed, own, 0.5 * shares + 0.5 * (neighbours @ shares))
    return np.asarray(shares)


def _distance(
    points: Float[np.ndarray, "vertex 2"],
    start: Float[np.ndarray, " 2"],
    end: Float[np.ndarray, " 2"],
) -> Float[np.ndarray, " vertex"]:
    """To a segment."""
    along = end - start
    t = ((points - start) @ along / (along @ along)).clip(0, 1)
    return np.asarray(np.linalg.norm(points - start - t[:, None] * along, axis=1))


def _thumb_share(source: SourceHand, skeleton: Skeleton) -> Float[np.ndarray, " vertex"]:
    """How much the thumb's metacarpal carries: harmonic between the thumb and the rest of the hand."""
    vertices = source.vertices
    cmc, mcp = skeleton.bone(13)
    along = unit(mcp - cmc)
    length = np.linalg.norm(mcp - cmc)
    offset = vertices - cmc
    t = offset @ along / length
    away = np.linalg.norm(offset - np.outer(offset @ along, along), axis=1)
    rigs_thumb = source.finger_weights[:, SOURCE_ROW["thumb"]]
    one = (rigs_thumb > 0.98) | ((t > 0.72) & (away < 0.017) & (rigs_thumb > 0.5))
    zero = (t < -0.1) | ((rigs_thumb < 0.02) & (away > 0.021))
    return _harmonic(source.faces, one, zero & ~one)


def _harmonic(
    faces: Int[np.ndarray, "face 3"],
    one: Bool[np.ndarray, " vertex"],
    zero: Bool[np.ndarray, " vertex"],
) -> Float[np.ndarray, " vertex"]:
    """The smoothest function over the mesh's edges with both sets held."""
    average = _neighbour_average(faces, len(one))
    free = ~(one | zero)
    system = sparse.identity(int(free.sum())) - average[free][:, free]
    values = one.astype(float)
    values[free] = spsolve(system.tocsc(), average[free][:, one].sum(axis=1).A1)
    return values


def _neighbour_average(faces: Int[np.ndarray, "face 3"], count: int) -> sparse.csr_matrix:
    """Each row averages over a vertex's neighbours."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    ones = np.ones(len(edges))
    adjacency = sparse.csr_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return sparse.csr_matrix(sparse.diags(1 / adjacency.sum(axis=1).A1) @ adjacency)
