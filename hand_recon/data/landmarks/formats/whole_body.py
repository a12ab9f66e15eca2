"""Hands among the keypoints of a person, and joints of headsets, by the number of points.

    21          one hand in FreiHAND's order
    133, 136    COCO-WholeBody (Jin et al., ECCV 2020): left hand 91 to 111, right hand 112 to 132;
                Halpe-FullBody (Fang et al., TPAMI 2022): 94 to 114 and 115 to 135
    26, 25      OpenXR's joints of a hand (`XR_EXT_hand_tracking`) and WebXR's, which have no palm

Persons of other numbers of keypoints, such as COCO's 17, have no hands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from hand_recon.data.landmarks.formats.names import landmarks_of_names
from hand_recon.hand.skeleton import LANDMARK_PARENTS

HANDS_OF: Final[Mapping[int, Mapping[str | None, range]]] = {
    21: {None: range(21)},
    133: {"left": range(91, 112), "right": range(112, 133)},
    136: {"left": range(94, 115), "right": range(115, 136)},
}
"""Number of keypoints → indices of each hand's landmarks; the side None is unknown."""

OPENXR: Final = (1, 2, 3, 4, 5, 7, 8, 9, 10, 12, 13, 14, 15, 17, 18, 19, 20, 22, 23, 24, 25)
"""Indices of FreiHAND's 21 landmarks among OpenXR's 26 joints; the palm and four metacarpals are left out."""

WEBXR: Final = tuple(joint - 1 for joint in OPENXR)
"""Indices of FreiHAND's 21 landmarks among WebXR's 25 joints."""

XR_JOINTS: Final = {26: OPENXR, 25: WEBXR}
"""Number of joints → indices of the 21 landmarks."""

XR_NAMES: Final = {26: "OpenXR's 26 joints", 25: "WebXR's 25 joints"}
"""Number of joints → words for them."""


@dataclass(frozen=True)
class Layout:
    """Places of the hands' landmarks in a list of keypoints."""

    hands: Mapping[str | None, Int[np.ndarray, " landmark=21"]]
    """Indices of the 21 landmarks by side; −1 for one that the list does not have."""
    named: bool = False
    """True if names told the places."""


def layout_of(keypoints: int, names: Sequence[str] = ()) -> Layout | None:
    """Places of the hands among keypoints, by their names where these name hands, else by their number.

    Args:
        keypoints: Number of keypoints.
        names: Their names; empty if they are unknown.

    Returns:
        None if there are no hands among that many keypoints.
    """
    by_name = _layout_of_names(names) if len(names) == keypoints else None
    if by_name is not None:
        return by_name
    hands = HANDS_OF.get(keypoints)
    if hands is None:
        return None
    return Layout({side: np.array(indices, dtype=np.int64) for side, indices in hands.items()})


def _layout_of_names(names: Sequence[str]) -> Layout | None:
    """Places by name; None unless each side that occurs has a finger's landmark for every second place."""
    known = landmarks_of_names(names)
    hands: dict[str | None, Int[np.ndarray, " landmark=21"]] = {}
    for position, name in enumerate(names):
        if name not in known:
            continue
        found = known[name]
        places = hands.setdefault(found.side, np.full(21, -1, dtype=np.int64))
        # A body's wrist comes before the hand's own, which is the one to take.
        if places[found.landmark] >= 0 and found.landmark > 0:
            return None
        places[found.landmark] = position
    # A body has wrists, too, and tips of some fingers.
    whole = {side: places for side, places in hands.items() if (places >= 0).sum() > 10}
    return Layout(whole, named=True) if whole else None


def pick(
    values: Float[np.ndarray, "..."], places: Int[np.ndarray, " landmark=21"]
) -> Float[np.ndarray, "..."]:
    """A hand's values among those of all keypoints, the first axis; NaN for landmarks without a place."""
    chosen = values[places].astype(np.float64)
    chosen[places < 0] = np.nan
    return chosen


def bone_length(points: Float[np.ndarray, "landmark=21 2"]) -> float:
    """Sum of the lengths of a hand's bones whose ends are known."""
    parents = np.array(LANDMARK_PARENTS[1:])
    return float(np.nansum(np.linalg.norm(points[1:] - points[parents], axis=-1)))


def is_xr_hand(points: Float[np.ndarray, "joint 2"]) -> bool:
    """True if 26 or 25 points look like the joints of a headset's hand.

    Read as such, the bones are shorter than with the first 21 points read in FreiHAND's order.
    """
    as_joints = points[list(XR_JOINTS[len(points)])]
    return bone_length(as_joints) < bone_length(points[:21])
