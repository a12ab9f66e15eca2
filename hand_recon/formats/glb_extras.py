"""Properties of a hand in an animated GLB that glTF has no place for: `extras` of the node of its mesh.

hand, side, seen   number and side; false for each frame in which a gap was bridged
frames, times      number, and seconds from the clip's start, of each frame
landmarks          names of the 21 landmarks
landmarks_3d       frame × 21 × 3, metres, in the scene's axes (x right, y up, z back)
covariance_3d      frame × 21 × 3 × 3, covariance of each landmark from the hand's origin, square metres, in
                   the scene's axes; null for a frame without an estimate
"""

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from hand_recon.formats.exported_hands import ExportedHand
from hand_recon.hand.skeleton import LANDMARKS
from hand_recon.rendering.mesh_files import CAMERA_TO_GLTF

_DIGITS: Final = 5
"""Significant digits of a covariance."""


def glb_extras(hand: ExportedHand) -> dict[str, Any]:
    """Collect the properties of a hand.

    Args:
        hand: The hand.
    """
    motion, axes = hand.trajectory, np.array(CAMERA_TO_GLTF)
    return {
        "hand": motion.hand,
        "side": motion.side,
        "seen": motion.observed.tolist(),
        "frames": motion.frames.tolist(),
        "times": motion.times.round(6).tolist(),
        "landmarks": list(LANDMARKS),
        "landmarks_3d": ((hand.landmarks * axes).round(6) + 0.0).tolist(),
        "covariance_3d": [_covariance(one * np.outer(axes, axes)) for one in hand.covariance],
    }


def _covariance(values: Float[np.ndarray, "landmark=21 3 3"]) -> list[Any] | None:
    if not np.isfinite(values).all():
        return None
    flat = [float(f"{value:.{_DIGITS}g}") for value in (values + 0.0).ravel().tolist()]
    nested: list[Any] = np.array(flat).reshape(values.shape).tolist()
    return nested
