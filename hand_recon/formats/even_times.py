"""Rows at even times, which the files of motion capture and biomechanics need, from the frames of a hand."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from hand_recon.formats.bvh import STEADY
from hand_recon.formats.joint_motion import SINGLE_FRAME
from hand_recon.motion.trajectory import Trajectory

_LONGEST_STEP: Final = 1.5
"""Frames, from one with the hand to the next, beyond which there is a gap between them."""


@dataclass(frozen=True)
class EvenRows:
    """Rows from a hand's first frame to its last, a constant step apart."""

    times: Float[np.ndarray, " row"]
    """Time of each row, seconds from the clip's start."""
    step: float
    """Seconds from row to row."""
    before: Int[np.ndarray, " row"]
    """Index of the frame before each row."""
    share: Float[np.ndarray, " row"]
    """Place of each row between that frame and the next, 0 to 1."""
    in_gap: Bool[np.ndarray, " row"]
    """Mask of the rows between two frames that are further apart than neighbours."""

    def sample(self, values: Float[np.ndarray, "frame ..."]) -> Float[np.ndarray, "row ..."]:
        """Values at the rows, on lines between those of the frames.

        Args:
            values: A row for each frame.
        """
        after = np.minimum(self.before + 1, len(values) - 1)
        share = self.share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.asarray((1 - share) * values[self.before] + share * values[after])


def even_rows(trajectory: Trajectory) -> EvenRows:
    """Choose the rows: the frames themselves where they are even, with rows for those that are missing.

    Where times vary by more than `hand_recon.formats.bvh.STEADY` frames, rows are the median step apart.

    Args:
        trajectory: The hand, with at least one frame.
    """
    numbers, times = trajectory.frames, trajectory.times
    if len(times) == 1:
        return EvenRows(
            times.copy(), SINGLE_FRAME, np.zeros(1, int), np.zeros(1), np.zeros(1, dtype=bool)
        )
    length = float(times[-1] - times[0])
    step = length / int(numbers[-1] - numbers[0])
    positions = (times - times[0]) / step
    if np.abs(positions - (numbers - numbers[0])).max() <= STEADY:
        positions = (numbers - numbers[0]).astype(np.float64)
        count = int(positions[-1])
    else:
        steps = np.diff(times) / np.diff(numbers)
        count = max(1, round(length / float(np.median(steps))))
        step = length / count
        positions = (times - times[0]) / step
        # Rounding must not lead beyond the last frame.
        positions[-1] = count
    rows = np.arange(count + 1)
    before = np.clip(np.searchsorted(positions, rows, side="right") - 1, 0, len(times) - 2)
    share = (rows - positions[before]) / np.diff(positions)[before]
    is_wide = np.diff(numbers)[before] > _LONGEST_STEP
    inside = (share > 0) & (share < 1)
    return EvenRows(times[0] + rows * step, step, before, share, is_wide & inside)
