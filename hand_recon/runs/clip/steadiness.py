"""Jitter of a hand's motion before and after smoothing."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from hand_recon.hand.model import HandModel
from hand_recon.motion.jitter import jitter_millimetres, jitter_pixels
from hand_recon.motion.posing import landmarks_of
from hand_recon.runs.clip.motion_of_hands import HandMotion


def steadiness(
    motions: Sequence[HandMotion], hand: HandModel, intrinsics: Float[np.ndarray, "3 3"]
) -> list[dict[str, Any]]:
    """Jitter of every hand: mean acceleration of its landmarks in mm/s², and RMS in pixels.

    Args:
        motions: Motion of every hand, before and after smoothing.
        hand: The hand model.
        intrinsics: Camera matrix of the clip, pixels.
    """
    light = hand.landmarks_only()
    rows = []
    for motion in motions:
        row: dict[str, Any] = {"hand": motion.smooth.hand}
        for name, one in (("before", motion.raw), ("after", motion.smooth)):
            points = landmarks_of(one, light)
            pixels = points @ intrinsics.T
            pixels = pixels[..., :2] / pixels[..., 2:]
            row[f"jitter_{name}_mm_per_s2"] = _rounded(jitter_millimetres(points, one.times))
            row[f"jitter_{name}_px"] = _rounded(jitter_pixels(pixels, one.times))
        rows.append(row)
    return rows


def _rounded(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
