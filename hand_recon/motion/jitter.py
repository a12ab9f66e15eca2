"""Jitter of a motion: its acceleration, and how far points are from between their neighbours in time."""

from typing import Final

import numpy as np
from jaxtyping import Bool, Float

LONGEST_STEP: Final = 1.5
"""Longest step between frames that is not a gap, in median steps."""


def jitter_millimetres(
    points: Float[np.ndarray, "frame point 3"], times: Float[np.ndarray, " frame"]
) -> float:
    """Mean size of the points' acceleration, mm/s²; not a number without three frames in a row.

    Args:
        points: Points in each frame, metres.
        times: Increasing times, seconds.
    """
    return _mean_size(1000 * accelerations(points, times))


def acceleration_error(
    points: Float[np.ndarray, "frame point 3"],
    ground_truth: Float[np.ndarray, "frame point 3"],
    times: Float[np.ndarray, " frame"],
) -> float:
    """Mean size of the difference of the accelerations of points and ground truth, mm/s².

    Args:
        points: Points in each frame, metres.
        ground_truth: The same points, metres.
        times: Increasing times, seconds.
    """
    return _mean_size(1000 * accelerations(points - ground_truth, times))


def jitter_pixels(
    points: Float[np.ndarray, "frame point 2"], times: Float[np.ndarray, " frame"]
) -> float:
    """Root mean square distance of points from between their neighbours in time, pixels.

    Between means on the straight line from the frame before to the one after, at the time of the frame: for
    even times, xₜ − (xₜ₋₁ + xₜ₊₁) / 2. Noise of standard deviation σ in each coordinate, independent in every
    frame, gives √3 σ.

    Args:
        points: Points in each frame, pixels.
        times: Increasing times, seconds.
    """
    step = np.diff(times)[:, None, None]
    share = step[1:] / (step[1:] + step[:-1])
    off = points[1:-1] - share * points[:-2] - (1 - share) * points[2:]
    squares = np.square(off[in_a_row(times)]).sum(axis=-1)
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")


def accelerations(
    points: Float[np.ndarray, "frame point axis"], times: Float[np.ndarray, " frame"]
) -> Float[np.ndarray, "triple point axis"]:
    """Second derivatives by time at the frames that have both neighbours, per s².

    They are exact for motion with constant acceleration, at even and uneven times.

    Args:
        points: Points in each frame.
        times: Increasing times, seconds.
    """
    step = np.diff(times)[:, None, None]
    velocity = np.diff(points, axis=0) / step
    found = np.diff(velocity, axis=0) / ((step[1:] + step[:-1]) / 2)
    return np.asarray(found[in_a_row(times)])


def in_a_row(times: Float[np.ndarray, " frame"]) -> Bool[np.ndarray, " inner"]:
    """Mask of the inner frames without a gap before or after them.

    Args:
        times: Increasing times, seconds.
    """
    step = np.diff(times)
    if len(step) < 2:
        return np.zeros(0, dtype=bool)
    steady = step <= LONGEST_STEP * np.median(step)
    return np.asarray(steady[1:] & steady[:-1])


def _mean_size(vectors: Float[np.ndarray, "triple point axis"]) -> float:
    return float(np.linalg.norm(vectors, axis=-1).mean()) if vectors.size else float("nan")
