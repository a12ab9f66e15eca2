"""Smoothing of a hand's motion over a whole clip (Sec. 3.3).

The model is a constant velocity that white noise accelerates, for each of the 51 coordinates, with the pose
of every frame as its measurement. The most probable motion x(t) given all frames, which a Kalman filter with
a backward pass would find, minimizes

    Σᵢ cᵢ Δᵢ (xᵢ − zᵢ)² + τ⁴ ∫ ẍ(t)² dt,

where zᵢ is the pose of frame i, cᵢ its certainty, Δᵢ the time that it stands for (`spans`), and τ the
strength in seconds. Its solution is a cubic smoothing spline, found here in one banded system (Reinsch,
1967).

In the words of the filter, a measurement of certainty one has the variance 1 / Δᵢ, and the acceleration the
density 1 / τ⁴. A sine of frequency f is multiplied by 1 / (1 + (2π f τ)⁴ / c): at c = 1 half of it is left at
f = 1 / (2π τ), whatever the frame rate. Noise that is independent in every frame keeps the share
3 Δ / (8 √2 τ) of its variance, as by averaging over 3.8 τ. Hands of a certainty c are smoothed like typical
ones with τ / c¼. The same certainty for all coordinates keeps a hand's parts together: with the whole
covariances, or with one certainty for each finger, projections jitter more (decision 78).
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from hand_recon.motion.estimates import ANGLES, PLACE, ROTATION
from hand_recon.motion.poses import Poses, coordinates_of, rotated

DEFAULT_SECONDS: Final = 0.03
"""Strength τ by default (decision 78)."""

MOST_SECONDS: Final = 1.0
"""Largest strength τ, beyond which no motion of a hand is left."""

LONGEST_SPAN: Final = 0.1
"""Longest time that one frame stands for, seconds: a frame after a gap does not stand for the gap."""


def checked_seconds(seconds: float) -> float:
    """The strength of smoothing, if it is one.

    Args:
        seconds: Strength τ, seconds.

    Raises:
        ValueError: It is negative, larger than `MOST_SECONDS` or no number.
    """
    if not 0 <= seconds <= MOST_SECONDS:
        raise ValueError(
            f"Found a smoothing of {seconds} s; expected 0 (none) to {MOST_SECONDS:g} s. "
            f"Use {DEFAULT_SECONDS:g} unless motion is slow or jitters much."
        )
    return seconds


def spans(times: Float[np.ndarray, " frame"]) -> Float[np.ndarray, " frame"]:
    """Time that each frame stands for: that since the frame before, at most `LONGEST_SPAN`, in seconds.

    The first frame stands for as long as the second.

    Args:
        times: Increasing times, seconds.
    """
    since = np.minimum(np.diff(times), LONGEST_SPAN)
    return np.concatenate([since[:1], since]) if len(since) else np.full(len(times), LONGEST_SPAN)


def smoothed(poses: Poses, seconds: float = DEFAULT_SECONDS) -> Poses:
    """Smooth a hand's motion.

    No joint angle leaves the interval from its least to its largest input, so that ranges of motion which
    hold before hold afterwards.

    Args:
        poses: Pose in each frame in which the hand was seen, of one frame or more.
        seconds: Strength τ, seconds; 0 returns the poses as they are.

    Raises:
        ValueError: The strength is none.
    """
    if checked_seconds(seconds) == 0 or len(poses) < 3:
        return poses
    measured = coordinates_of(poses)
    weights = poses.certainty * spans(poses.times)
    found = smoothing_spline(poses.times, measured, weights, seconds)
    turned = found[:, ROTATION] - measured[:, ROTATION]
    return replace(
        poses,
        joint_angles=within(found[:, ANGLES], measured[:, ANGLES]).reshape(-1, 15, 3),
        root_rotation=rotated(poses.root_rotation, turned),
        place=found[:, PLACE],
    )


def within(
    values: Float[np.ndarray, "frame value"], given: Float[np.ndarray, "other value"]
) -> Float[np.ndarray, "frame value"]:
    """Values between the least and the largest of others in the same column.

    Args:
        values: Values.
        given: Others, one row or more.
    """
    return np.clip(values, given.min(axis=0), given.max(axis=0))


def smoothing_spline(
    times: Float[np.ndarray, " frame"],
    values: Float[np.ndarray, "frame value"],
    weights: Float[np.ndarray, " frame"],
    seconds: float,
) -> Float[np.ndarray, "frame value"]:
    """Values of the curves that minimize Σ w (x − z)² + τ⁴ ∫ ẍ².

    With Q the matrix of divided second differences, R the tridiagonal matrix of the overlaps of the linear
    splines at the inner times and W the weights, the second derivatives γ at these times solve

        (R + τ⁴ Qᵀ W⁻¹ Q) γ = Qᵀ z, and x = z − τ⁴ W⁻¹ Q γ.

    Args:
        times: Increasing times of three frames or more.
        values: Measurements z, in columns.
        weights: Weights w, larger than zero, one per frame.
        seconds: Strength τ.
    """
    step = np.diff(times)
    # Columns of Q: factors of the value before, at and after each inner time.
    before, after = 1 / step[:-1], 1 / step[1:]
    at = -(before + after)
    loose = seconds**4 / weights
    banded = np.zeros((3, len(at)))
    banded[0] = (step[:-1] + step[1:]) / 3
    banded[0] += before**2 * loose[:-2] + at**2 * loose[1:-1] + after**2 * loose[2:]
    banded[1, :-1] = step[1:-1] / 6
    banded[1, :-1] += at[:-1] * before[1:] * loose[1:-2] + after[:-1] * at[1:] * loose[2:-1]
    banded[2, :-2] = after[:-2] * before[2:] * loose[2:-2]
    right = before[:, None] * values[:-2] + at[:, None] * values[1:-1] + after[:, None] * values[2:]
    bends = solveh_banded(banded, right, lower=True)
    pulled = np.zeros_like(values)
    pulled[:-2] += before[:, None] * bends
    pulled[1:-1] += at[:, None] * bends
    pulled[2:] += after[:, None] * bends
    return np.asarray(values - loose[:, None] * pulled)
