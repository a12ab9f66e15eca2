"""Motion of one hand: its parameters at every frame from its first to its last."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.detection.detector import Side


@dataclass(frozen=True)
class Trajectory:
    """Motion of one hand of a clip, with one shape.

    Joint angles and shape mean the same for a left hand as for the right one that it mirrors. Rotation and
    translation are those of the model of the hand's own side: a left hand's model is the right one's with
    x → −x, as in files of hands.

    Raises:
        ValueError: Times do not increase, or the numbers of frames differ.
    """

    hand: int
    """Number of the hand in the clip, from 1."""
    side: Side
    """Side of the hand."""
    frames: Int[np.ndarray, " frame"]
    """Number of each frame in the clip, from 0."""
    times: Float[np.ndarray, " frame"]
    """Time of each frame, seconds from the clip's start."""
    joint_angles: Float[np.ndarray, "frame joint=15 axis=3"]
    """Bend, splay and twist, radians."""
    root_rotation: Float[np.ndarray, "frame 3 3"]
    """Rotation from the hand's frame to the camera's."""
    translation: Float[np.ndarray, "frame 3"]
    """Origin of the hand's frame (the middle MCP) in the camera's (x right, y down, z forward), metres."""
    shape: Float[np.ndarray, " direction=10"]
    """Shape coefficients, standard deviations."""
    observed: Bool[np.ndarray, " frame"]
    """True where the hand was seen, false where a gap was bridged."""

    def __post_init__(self) -> None:
        counts = {
            len(values)
            for values in (
                self.frames, self.times, self.joint_angles, self.root_rotation, self.translation,
                self.observed,
            )
        }  # fmt: skip
        if len(counts) > 1:
            raise ValueError(
                f"Hand {self.hand} has fields of {sorted(counts)} frames; expected as many everywhere."
            )
        if (np.diff(self.times) <= 0).any():
            raise ValueError(
                f"The times of hand {self.hand} do not increase; expected one time per frame, in seconds."
            )

    def __len__(self) -> int:
        return len(self.frames)


def mirror_of(side: Side) -> Float[np.ndarray, "3"]:
    """Factors of x, y and z from a right hand's frame to that of a hand of a side.

    They also lead from the camera's frame to that in which a left hand is a right one.

    Args:
        side: Side of the hand.
    """
    return np.array([-1.0 if side == "left" else 1.0, 1.0, 1.0])
