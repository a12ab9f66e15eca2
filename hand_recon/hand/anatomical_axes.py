"""Anatomical axes of each joint and the rest pose's joint angles, from a skeleton at rest (Sec. 3.2).

The neutral pose is the anatomical one, independent of the pose in which a hand was modelled: fingers
straight and parallel to the third metacarpal, the thumb's metacarpal in line with the trapezium
(`docs/open_hand.md`). Equal joint angles therefore mean the same pose of the open hand and of MANO.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

ARCH: Final = {"index": 2.0, "middle": 0.0, "ring": -2.0, "little": -5.0}
"""Tilt of each finger's dorsal side towards the thumb, degrees: the transverse arch of the MCP heads.

It is smaller than the arch of the bones, because fingers that bend together lie closely side by side.
"""

TRAPEZIUM: Final = (48.0, 38.0, 80.0)
"""Flexion, abduction and pronation of the trapezium from the third metacarpal, degrees (Cooney 1981)."""

ORDER: Final = ("index", "middle", "little", "ring", "thumb")
"""MANO's order of fingers."""


def axes_at_rest(
    joints: Float[np.ndarray, "joint=16 3"], tips: Float[np.ndarray, "finger=5 3"]
) -> tuple[Float[np.ndarray, "joint=15 3 3"], Float[np.ndarray, "joint=15 axis=3"]]:
    """Compute the axes of every joint and the joint angles of the rest pose.

    Args:
        joints: Rotation centres of a right hand at rest, metres.
        tips: Fingertips in MANO's order, metres.

    Returns:
        Axes of each child segment at rest, one per column: twist, splay, bend; and bend, splay and
        twist of the rest pose from the anatomical neutral, radians.
    """
    frames, angles = np.zeros((15, 3, 3)), np.zeros((15, 3))
    third_metacarpal = unit(joints[0] - joints[4])
    for position, finger in enumerate(ORDER):
        chain = np.vstack([joints[1 + 3 * position : 4 + 3 * position], tips[position]])
        neutral = _root_neutral(finger, third_metacarpal)
        for part in range(3):
            joint = 3 * position + part
            bone = unit(chain[part] - chain[part + 1])
            local = neutral.T @ bone
            # R_y(splay) R_z(bend) takes the first axis to (cos b cos s, sin b, −cos b sin s).
            bend, splay = np.arcsin(local[1]), np.arctan2(-local[2], local[0])
            frames[joint] = neutral @ rotation(1, splay) @ rotation(2, bend)
            angles[joint] = bend, splay, 0.0
            neutral = frames[joint]
    return frames, angles


def trapezium_frame(proximal: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Twist, splay and bend axes of the thumb's CMC at neutral, one per column.

    At neutral, the thumb's metacarpal is in line with the trapezium, whose axes are rotated from the third
    metacarpal's by 48° of flexion, 38° of abduction and 80° of pronation (Cooney et al. 1981).

    Args:
        proximal: Along the third metacarpal, towards the wrist.
    """
    third_metacarpal = frame_along(proximal, np.array([0.0, 1.0, 0.0]))
    flexion, abduction, pronation = np.radians(TRAPEZIUM)
    local = rotation(1, abduction) @ rotation(2, flexion) @ rotation(0, pronation)
    return np.asarray(third_metacarpal @ local)


def frame_along(
    proximal: Float[np.ndarray, " 3"], dorsal: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 3"]:
    """Right-handed axes in columns: towards the wrist, dorsal, and their cross product."""
    x = unit(proximal)
    y = unit(dorsal - dorsal @ x * x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def rotation(axis: int, angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix about a coordinate axis, 0 to 2, by an angle in radians."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first], matrix[first, second] = np.sin(angle), -np.sin(angle)
    return matrix


def unit(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Scale vectors to unit length."""
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def _root_neutral(
    finger: str, third_metacarpal: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 3"]:
    """Axes of the first segment at neutral: fingers parallel to the third metacarpal (AAOS)."""
    if finger == "thumb":
        return trapezium_frame(third_metacarpal)
    tilt = np.radians(ARCH[finger])
    return frame_along(third_metacarpal, np.array([0.0, np.cos(tilt), np.sin(tilt)]))
