"""Estimates of a fit for one hand in each frame, before frames are compared with each other (Sec. 3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np
from jaxtyping import Float, Int

ANGLES: Final = slice(0, 45)
"""Joint angles among the coordinates of a pose, joint by joint: bend, splay, twist, radians."""
ROTATION: Final = slice(45, 48)
"""Axis angle of a rotation that is applied after the root rotation, in the camera's axes, radians."""
PLACE: Final = slice(48, 51)
"""Place of the hand's origin: x / z, y / z, and the logarithm of z in metres."""
COORDINATES: Final = 51
"""Coordinates of a pose."""


@dataclass(frozen=True)
class FrameEstimates:
    """Minima of the loss of one hand in every frame in which it was seen, all with one shape.

    Left hands are mirrored to right hands, and the camera with them.
    """

    frames: Int[np.ndarray, " frame"]
    """Number of each frame in the clip, increasing."""
    times: Float[np.ndarray, " frame"]
    """Time of each frame, seconds, increasing."""
    joint_angles: Float[np.ndarray, "frame minimum joint=15 axis=3"]
    """Bend, splay and twist at each minimum, radians."""
    root_rotation: Float[np.ndarray, "frame minimum 3 3"]
    """Rotation from the hand's frame to the camera's."""
    place: Float[np.ndarray, "frame minimum 3"]
    """Origin of the hand's frame: x / z, y / z, and the logarithm of z in metres."""
    certainty: Float[np.ndarray, "frame minimum"]
    """Certainty of each minimum, one for a typical hand: `certainty_of` its inverse covariance."""
    cost: Float[np.ndarray, "frame minimum"]
    """Negative logarithm of each minimum's share of probability, up to a constant of the frame; infinite
    for a minimum that is absent or repeats another."""

    def __len__(self) -> int:
        return len(self.frames)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Estimates of several runs of frames as one.

        Args:
            parts: Estimates of one hand, in the order of their frames.
        """
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
