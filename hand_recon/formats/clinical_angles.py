"""Joint angles under their clinical names, in degrees, with the signs that clinicians use.

A bend is flexion, with extension below zero. A splay of an MCP is abduction, away from the middle finger,
with adduction below zero; the middle finger itself, and the outer joints, deviate to the radial side (the
thumb's), with ulnar deviation below zero. The thumb's abduction leads its metacarpal away from the palm. A
twist is pronation, by which the back of the finger rotates to the radial side, with supination below zero.
All of them are counted from the straight finger (`docs/conventions.md`), and mean the same for left and right
hands.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.motion.trajectory import Trajectory


@dataclass(frozen=True)
class ClinicalAngle:
    """One of the 45 joint angles of a hand."""

    name: str
    """Name of a column, such as `index_MCP_flexion`."""
    joint: int
    """Index of the joint among the 15."""
    axis: int
    """Index of the axis: bend, splay, twist."""
    sign: float
    """Sign of the clinical angle in relation to the joint angle."""


def _angle(joint: int, axis: int) -> ClinicalAngle:
    finger, part = ARTICULATED[joint].split()
    movement, sign = {"bend": ("flexion", 1.0), "twist": ("pronation", 1.0)}.get(
        AXES[axis], _sideways(finger, part)
    )
    return ClinicalAngle(f"{finger}_{part}_{movement}", joint, axis, sign)


def _sideways(finger: str, part: str) -> tuple[str, float]:
    """Movement that a splay is, and its sign: a positive splay of a finger is towards the thumb."""
    if finger == "thumb" or (finger == "index" and part == "MCP"):
        return "abduction", 1.0
    if finger in {"ring", "little"} and part == "MCP":
        return "abduction", -1.0
    return "radial_deviation", 1.0


CLINICAL_ANGLES: Final = tuple(
    _angle(joint, axis) for joint in range(len(ARTICULATED)) for axis in range(len(AXES))
)
"""All angles, joint by joint."""


def clinical_degrees(trajectory: Trajectory) -> Float[np.ndarray, "frame angle=45"]:
    """Clinical angles of a motion, degrees, in the order of `CLINICAL_ANGLES`.

    Args:
        trajectory: The motion.
    """
    degrees = np.degrees(trajectory.joint_angles.astype(np.float64)).reshape(-1, 45)
    # Adding zero turns −0 into 0.
    return degrees * np.array([angle.sign for angle in CLINICAL_ANGLES]) + 0.0
