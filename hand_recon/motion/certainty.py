"""Certainty of a hand's pose as one number, from the second derivatives of the loss (Sec. 3.3)."""

from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.fitting.second_order.minima import FIXED_SIGMA, Minima
from hand_recon.motion.estimates import ANGLES, COORDINATES, FrameEstimates

TYPICAL: Final = 6.5
"""Mean logarithm of the information on a coordinate of a typical hand: a standard deviation of 2.2° along the
principal axes. Medians of three clips are 6.0, 6.5 and 6.8 (decision 78)."""

BOUNDS: Final = (0.01, 100.0)
"""Least and largest certainty: standard deviations ten times a typical hand's, and a tenth of them."""


def certainty_of(
    information: Float[np.ndarray, "*batch coordinate=51 coordinate=51"],
) -> Float[np.ndarray, "*batch"]:
    """Ratio of a typical hand's variance to that of a hand.

    It is the geometric mean over the principal axes of the coordinates, so it does not depend on the
    direction of the camera's axes. Angles whose range has no width do not count.

    Args:
        information: Inverse covariance of the coordinates; not a number for a minimum that is absent.
    """
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    fixed = np.zeros(diagonal.shape, dtype=bool)
    fixed[..., ANGLES] = diagonal[..., ANGLES] > 0.99 * FIXED_SIGMA**-2
    with np.errstate(invalid="ignore", divide="ignore"):
        sign, total = np.linalg.slogdet(information)
        total = total - np.log(np.where(fixed, diagonal, 1.0)).sum(axis=-1)
        ratio = np.exp(total / (COORDINATES - fixed.sum(axis=-1)) - TYPICAL)
    return np.where(sign > 0, np.clip(np.nan_to_num(ratio), *BOUNDS), BOUNDS[0])


def estimates_of(
    minima: Minima, frames: Int[np.ndarray, " frame"], times: Float[np.ndarray, " frame"]
) -> FrameEstimates:
    """Estimates of one hand in some frames.

    Args:
        minima: Minima of its loss, those of a frame in a row.
        frames: Numbers of the frames, increasing.
        times: Their times, seconds, increasing.
    """
    return FrameEstimates(
        frames=frames,
        times=times,
        joint_angles=minima.parameters.joint_angles.double().numpy(),
        root_rotation=minima.parameters.root_rotation.double().numpy(),
        place=minima.place.double().numpy(),
        certainty=certainty_of(minima.information.double().numpy()),
        cost=minima.cost.double().numpy(),
    )
