"""Two definitions of the 21 landmarks on the posed hand, as weights over vertices and centres."""

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import JOINT_OF_LANDMARK, JOINTS, LANDMARKS, PARENTS
from open_hand.skeleton import ORDER, SOURCE_ROW, Skeleton
from open_hand.source import SourceHand

RING_WIDTH = 0.0045
"""Reach of the ring of skin that carries a landmark, along the finger, metres."""

TIP_DEPTH = 0.0035
"""How far under the end of the finger annotators see the tip, metres."""


def knuckle_landmarks(
    vertices: Float[np.ndarray, "vertex 3"],
    weights: Float[np.ndarray, "vertex joint=16"],
    skeleton: Skeleton,
) -> Float[np.ndarray, "landmark=21 point"]:
    """Where annotators and detectors put points: the joints themselves, and just inside the tips."""
    regressor = np.zeros((21, len(vertices) + 16))
    for landmark, joint in JOINT_OF_LANDMARK.items():
        regressor[landmark, len(vertices) + joint] = 1.0
    for position, finger in enumerate(ORDER):
        joint = 3 + 3 * position
        base, tip = skeleton.bone(joint)
        along = (tip - base) / np.linalg.norm(tip - base)
        target = tip - TIP_DEPTH * along
        ring = weights[:, joint] > 0.9
        ring &= np.abs((vertices - target) @ along) < RING_WIDTH
        row = LANDMARKS.index(f"{finger} tip")
        regressor[row, : len(vertices)] = carried_by(vertices, ring, target)
    return regressor


def mano_landmarks(
    vertices: Float[np.ndarray, "vertex 3"],
    weights: Float[np.ndarray, "vertex joint=16"],
    source: SourceHand,
    skeleton: Skeleton,
) -> Float[np.ndarray, "landmark=21 point"]:
    """As MANO-labelled datasets: MCPs about a centimetre beyond the knuckles, tips on the skin.

    The source's rig has its centres in MANO's proportions; rings of skin carry them. The wrist is
    the same point in both sets.
    """
    regressor = np.zeros((21, len(vertices) + 16))
    regressor[0, len(vertices)] = 1.0
    for landmark, joint in JOINT_OF_LANDMARK.items():
        if joint == 0:
            continue
        position, part = divmod(joint - 1, 3)
        target = source.rig_joints[SOURCE_ROW[ORDER[position]]][part]
        ring = _ring(vertices, weights, target, joint, skeleton)
        regressor[landmark, : len(vertices)] = carried_by(vertices, ring, target)
    for position, finger in enumerate(ORDER):
        # The decimation keeps the fingertips as the first vertices, in this order.
        regressor[LANDMARKS.index(f"{finger} tip"), position] = 1.0
    return regressor


def _ring(
    vertices: Float[np.ndarray, "vertex 3"],
    weights: Float[np.ndarray, "vertex joint=16"],
    target: Float[np.ndarray, " 3"],
    joint: int,
    skeleton: Skeleton,
) -> np.ndarray:
    base, end = skeleton.bone(joint)
    along = (end - base) / np.linalg.norm(end - base)
    own = weights[:, joint] + weights[:, PARENTS[joint]]
    base_of_finger = (joint - 1) % 3 == 0 or joint == JOINTS.index("thumb MCP")
    near = np.linalg.norm(vertices - target, axis=1) < (0.030 if base_of_finger else 0.016)
    distance = np.abs((vertices - target) @ along)
    for reach in (RING_WIDTH, 1.5 * RING_WIDTH, 3.0 * RING_WIDTH):
        ring = (own > (0.6 if base_of_finger else 0.95)) & near & (distance < reach)
        if ring.sum() >= 8:
            return np.asarray(ring)
    raise ValueError(f"Fewer than eight vertices around {JOINTS[joint]}; widen the ring.")


def carried_by(
    vertices: Float[np.ndarray, "vertex 3"], ring: np.ndarray, target: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " vertex"]:
    """The most even weights over a ring of vertices that put their sum at the target."""
    chosen = np.flatnonzero(ring)
    system = np.vstack([vertices[chosen].T - target[:, None], np.ones(len(chosen))])
    even = np.full(len(chosen), 1 / len(chosen))
    miss = np.array([0, 0, 0, 1.0]) - system @ even
    weights = np.zeros(len(vertices))
    weights[chosen] = even + np.linalg.pinv(system) @ miss
    return weights
