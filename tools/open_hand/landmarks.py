"""Two definitions of the 21 landmarks on the posed hand, as weights over vertices and joint centres."""

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import JOINT_OF_LANDMARK, JOINTS, LANDMARKS, PARENTS
from open_hand.skeleton import ORDER, SOURCE_ROW, Skeleton
from open_hand.source import SourceHand

RING_WIDTH = 0.0045
"""Half width, along the finger, of the ring of skin that defines a landmark, metres."""

TIP_DEPTH = 0.0035
"""Distance of the annotated fingertip from the end of the finger, metres."""


def knuckle_landmarks(
    vertices: Float[np.ndarray, "vertex 3"],
    weights: Float[np.ndarray, "vertex joint=16"],
    skeleton: Skeleton,
) -> Float[np.ndarray, "landmark=21 point"]:
    """Landmarks of annotators and detectors: the joint centres, and points just inside the fingertips."""
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
        regressor[row, : len(vertices)] = ring_weights(vertices, ring, target)
    return regressor


def mano_landmarks(
    vertices: Float[np.ndarray, "vertex 3"],
    weights: Float[np.ndarray, "vertex joint=16"],
    source: SourceHand,
    skeleton: Skeleton,
) -> Float[np.ndarray, "landmark=21 point"]:
    """Landmarks of MANO-labelled datasets: MCPs about a centimetre distal of the joints, tips on the skin.

    The joint centres of the source's rig have MANO's proportions; rings of skin around them define the
    landmarks. The wrist is the same point in both sets.
    """
    regressor = np.zeros((21, len(vertices) + 16))
    regressor[0, len(vertices)] = 1.0
    for landmark, joint in JOINT_OF_LANDMARK.items():
        if joint == 0:
            continue
        position, part = divmod(joint - 1, 3)
        target = source.rig_joints[SOURCE_ROW[ORDER[position]]][part]
        ring = _ring(vertices, weights, target, joint, skeleton)
        regressor[landmark, : len(vertices)] = ring_weights(vertices, ring, target)
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
    raise ValueError(
        f"Found fewer than 8 vertices around {JOINTS[joint]}; expected 8 or more. Increase RING_WIDTH."
    )


def ring_weights(
    vertices: Float[np.ndarray, "vertex 3"], ring: np.ndarray, target: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " vertex"]:
    """The weights over a ring of vertices, as even as possible, whose weighted mean is the target."""
    chosen = np.flatnonzero(ring)
    system = np.vstack([vertices[chosen].T - target[:, None], np.ones(len(chosen))])
    even = np.full(len(chosen), 1 / len(chosen))
    miss = np.array([0, 0, 0, 1.0]) - system @ even
    weights = np.zeros(len(vertices))
    weights[chosen] = even + np.linalg.pinv(system) @ miss
    return weights
