"""The range-of-motion loss by definition in NumPy: Eq. 1 by joint and axis."""

import numpy as np


def range_of_motion_loss(angles: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Range-of-motion loss, Eq. 1: Σ_j max{θ_j − θ_max, θ_min − θ_j, 0}²."""
    flat = angles.reshape(-1, 15, 3)
    totals = []
    for hand in flat:
        total = 0.0
        for joint in range(15):
            for axis in range(3):
                excess = max(
                    hand[joint, axis] - upper[joint, axis],
                    lower[joint, axis] - hand[joint, axis],
                    0.0,
                )
                total += excess**2
        totals.append(total)
    return np.array(totals).reshape(angles.shape[:-2])
