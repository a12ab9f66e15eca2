"""21 landmarks out of the joints that headsets record: WebXR's 25 and OpenXR's 26 (XR_EXT_hand_tracking)."""

from typing import Final

from jaxtyping import Float
from torch import Tensor

_BONES: Final = ("metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip")

WEBXR: Final[tuple[str, ...]] = (
    "wrist",
    *(f"thumb-{bone}" for bone in _BONES if bone != "phalanx-intermediate"),
    *(
        f"{finger}-finger-{bone}"
        for finger in ("index", "middle", "ring", "pinky")
        for bone in _BONES
    ),
)
"""Joints of WebXR Hand Input, in its order; OpenXR has the palm before them."""

COUNTS: Final = (21, 25, 26)
"""Numbers of points of a hand that are read."""


def to_landmarks(
    points: Float[Tensor, "*batch point 3"],
) -> Float[Tensor, "*batch landmark=21 3"]:
    """Choose the 21 landmarks among the points of a hand.

    The bases of the four fingers' metacarpals and the palm have no landmark.

    Args:
        points: 21 landmarks, 25 joints in WebXR's order or 26 in OpenXR's, any unit.

    Raises:
        ValueError: There is another number of points.
    """
    count = points.shape[-2]
    if count == 21:
        return points
    if count not in COUNTS:
        raise ValueError(
            f"A hand has {count} points; expected 21 landmarks, 25 joints (WebXR) or 26 (OpenXR)."
        )
    chosen = [
        index + count - 25
        for index, name in enumerate(WEBXR)
        if not name.endswith("finger-metacarpal")
    ]
    return points[..., chosen, :]
