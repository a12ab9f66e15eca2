"""Skinning weights for the anatomical rotation centres, blended over the finger's thickness at each joint."""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from scipy.sparse.linalg import spsolve

from open_hand.skeleton import ORDER, SOURCE_ROW, Skeleton, unit
from open_hand.source import SourceHand

HALF_WIDTH = {"MCP": 0.0125, "PIP": 0.0065, "DIP": 0.0050}
"""Half length of the skin over which a joint's rotation is blended, metres."""

PALMAR_LAG = {"MCP": 0.55, "PIP": 0.0, "DIP": 0.0}
"""Distal offset of the blend per metre of depth below the rotation centre.

The palm's skin reaches 2 cm distal of the MCP centres, the dorsal skin does not.
"""

RAY_WIDTH = 0.0060
"""Width of the blend between neighbouring rays in the palm, metres."""

SMOOTHING_STEPS = 4
"""Averaging steps over neighbouring vertices at the end."""


def skinning_weights(
    source: SourceHand, skeleton: Skeleton
) -> Float[np.ndarray, "vertex joint=16"]:
    """Compute the weight of each joint at each vertex; fingers have no weight on each other's skin."""
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
            steps = [np.ones(len(vertices))]
        else:
            share = rays[:, position] * (1 - thumb)
            steps = [_step(vertices, skeleton, first, "MCP")]
        steps += [
            _step(vertices, skeleton, first + 1, "PIP"),
            _step(vertices, skeleton, first + 2, "DIP"),
        ]
        finger_weight = share * steps[0]
        weights[:, first] = finger_weight * (1 - steps[1])
        weights[:, first + 1] = finger_weight * steps[1] * (1 - steps[2])
        weights[:, first + 2] = finger_weight * steps[1] * steps[2]
    weights[:, 0] = 1 - weights.sum(axis=1)
    weights = weights.clip(min=0)
    for _ in range(SMOOTHING_STEPS):
        weights = 0.5 * weights + 0.5 * (neighbours @ weights)
        weights = _keep_apart(weights, owner)
    return weights


def _owners(source: SourceHand) -> Int[np.ndarray, " vertex"]:
    """Index, in MANO's order, of the finger that a vertex belongs to; −1 in the palm and the webs."""
    owner = np.full(len(source.vertices), -1)
    for position, finger in enumerate(ORDER):
        owner[source.finger_weights[:, SOURCE_ROW[finger]] > 0.98] = position
    return owner


def _keep_apart(
    weights: Float[np.ndarray, "vertex joint=16"], owner: Int[np.ndarray, " vertex"]
) -> Float[np.ndarray, "vertex joint=16"]:
    """Remove other fingers' weights from each finger's skin, keep the four largest, normalize the rows."""
    finger = np.concatenate([[-1], np.repeat(np.arange(5), 3)])
    foreign = (owner[:, None] >= 0) & (finger[None] >= 0) & (finger[None] != owner[:, None])
    weights = np.where(foreign, 0.0, weights)
    weakest = np.sort(weights, axis=1)[:, -4, None]
    weights = np.where((weights < weakest) | (weights < 1e-4), 0.0, weights)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _step(
    vertices: Float[np.ndarray, "vertex 3"], skeleton: Skeleton, joint: int, kind: str
) -> Float[np.ndarray, " vertex"]:
    """Smooth step along the bisector of a joint's two bones: 0 proximal of the joint, 1 distal."""
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
    """Cubic step from 0 at −1 to 1 at +1 with zero slope at both ends."""
    t = (0.5 * (position + 1)).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _ray_shares(
    source: SourceHand,
    skeleton: Skeleton,
    neighbours: sparse.csr_matrix,
    owner: Int[np.ndarray, " vertex"],
) -> Float[np.ndarray, "vertex finger=4"]:
    """Shares of the four fingers' rays in each vertex, by distance in the view from the back of the hand."""
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
    """Distance of each point to a line segment."""
    along = end - start
    t = ((points - start) @ along / (along @ along)).clip(0, 1)
    return np.asarray(np.linalg.norm(points - start - t[:, None] * along, axis=1))


def _thumb_share(source: SourceHand, skeleton: Skeleton) -> Float[np.ndarray, " vertex"]:
    """Weight of the thumb's metacarpal: harmonic between 1 on the thumb and 0 on the rest of the hand."""
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
    """The harmonic function over the mesh's edges that is 1 on one set and 0 on the other."""
    average = _neighbour_average(faces, len(one))
    free = ~(one | zero)
    system = sparse.identity(int(free.sum())) - average[free][:, free]
    values = one.astype(float)
    values[free] = spsolve(system.tocsc(), average[free][:, one].sum(axis=1).A1)
    return values


def _neighbour_average(faces: Int[np.ndarray, "face 3"], count: int) -> sparse.csr_matrix:
    """Matrix that averages over each vertex's neighbours."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    ones = np.ones(len(edges))
    adjacency = sparse.csr_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return sparse.csr_matrix(sparse.diags(1 / adjacency.sum(axis=1).A1) @ adjacency)
