"""Input of dex-retargeting and AnyTeleop for robot hands: 21 points of one hand in the operator's frame.

The arrays of the file:

    points          frame × 21 × 3, metres from the wrist, in the operator's frame: z along the fingers, x out
                    of the palm, y to the thumb on a right hand and to the little finger on a left one
    wrist_rotation  frame × 3 × 3, from the operator's frame to the camera's (x right, y down, z forward)
    wrist           frame × 3, position of the wrist in the camera's frame, metres
    time, frame     seconds from the clip's start, and number, of each frame with the hand
    seen            false where a gap of the clip was bridged
    is_right        true for a right hand

The order of the points is MediaPipe's, to which the `target_link_human_indices` of a retargeting's
configuration refer. With `type: position` it wants `points[t][indices]`, with `vector` and `dexpilot` the
differences `points[t][indices[1]] - points[t][indices[0]]`.
"""

import io
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.detection.detector import Side
from hand_recon.formats.exported_hands import ExportedHand
from hand_recon.formats.joint_motion import check_motions
from hand_recon.formats.new_file import write_new
from hand_recon.hand.skeleton import LANDMARKS

WRIST: Final = LANDMARKS.index("wrist")
INDEX: Final = LANDMARKS.index("index MCP")
MIDDLE: Final = LANDMARKS.index("middle MCP")

OPERATOR_AXES: Final[dict[Side, Float[np.ndarray, "3 3"]]] = {
    "right": np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "left": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""Axes of the operator's frame, in columns, in that of `palm_axes`."""


def palm_axes(points: Float[np.ndarray, "frame landmark=21 3"]) -> Float[np.ndarray, "frame 3 3"]:
    """Axes of the palm from three of its landmarks, in columns, on both sides by the same rule.

    The first leads from the middle MCP to the wrist, the third lies in the plane of these and the index MCP,
    on the index finger's side, and the second completes a right-handed frame: it leaves the back of a right
    hand, and the palm of a left one.

    Args:
        points: Landmarks in any frame.
    """
    along = points[:, WRIST] - points[:, MIDDLE]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    aside = points[:, INDEX] - points[:, MIDDLE]
    aside -= (aside * along).sum(axis=-1, keepdims=True) * along
    aside /= np.linalg.norm(aside, axis=-1, keepdims=True)
    return np.stack([along, np.cross(aside, along), aside], axis=-1)


def operator_points(
    points: Float[np.ndarray, "frame landmark=21 3"], side: Side
) -> tuple[Float[np.ndarray, "frame landmark=21 3"], Float[np.ndarray, "frame 3 3"]]:
    """Convert landmarks to the operator's frame.

    Args:
        points: Landmarks, camera frame, metres.
        side: Side of the hand.

    Returns:
        Landmarks from the wrist in the operator's frame, and the rotation from it to the camera's.
    """
    rotation = palm_axes(points) @ OPERATOR_AXES[side]
    return (points - points[:, WRIST, None]) @ rotation, rotation


def write_dex_retargeting(path: str | Path, hand: ExportedHand) -> Path:
    """Write the points of a hand as a NumPy archive; folders are made.

    Args:
        path: File to write.
        hand: The hand.

    Raises:
        FileExistsError: The file exists.
        ValueError: The hand has no frame, numbers are not finite, or a time is negative.
    """
    check_motions([hand.trajectory])
    motion = hand.trajectory
    points, rotation = operator_points(hand.landmarks, motion.side)
    stream = io.BytesIO()
    np.savez_compressed(
        stream, points=points, wrist_rotation=rotation, wrist=hand.landmarks[:, WRIST],
        time=motion.times, frame=motion.frames, seen=motion.observed, is_right=motion.side == "right",
    )  # fmt: skip
    return write_new(path, stream.getvalue())
