"""Names and orders of the 16 joints and the 21 landmarks, and permutations between conventions.

Joints are MANO's (Sec. 3.1): the wrist, then three per finger in the order index, middle, little, ring,
thumb. Landmarks are FreiHAND's, which OpenPose, DexYCB, MediaPipe and COCO-WholeBody share: the wrist,
then four per finger from base to tip, thumb first.
"""

from typing import Final

JOINTS: Final[tuple[str, ...]] = (
    "wrist",
    "index MCP",
    "index PIP",
    "index DIP",
    "middle MCP",
    "middle PIP",
    "middle DIP",
    "little MCP",
    "little PIP",
    "little DIP",
    "ring MCP",
    "ring PIP",
    "ring DIP",
    "thumb CMC",
    "thumb MCP",
    "thumb IP",
)
"""The 16 rotation centres in MANO's order; the last 15 are the articulated joints of the paper."""

ARTICULATED: Final[tuple[str, ...]] = JOINTS[1:]
"""The 15 joints that have joint angles, in the order of every `joint=15` axis."""

PARENTS: Final[tuple[int, ...]] = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14)
"""Parent of each joint."""

JOINT_LEVELS: Final[tuple[tuple[int, ...], ...]] = (
    (1, 4, 7, 10, 13),
    (2, 5, 8, 11, 14),
    (3, 6, 9, 12, 15),
)
"""Joints by depth in the skeleton, so that forward kinematics takes three batched steps."""

LEVEL_ORDER: Final[tuple[int, ...]] = (0, *(joint for level in JOINT_LEVELS for joint in level))
"""All joints by depth in the skeleton."""

AXES: Final[tuple[str, ...]] = ("bend", "splay", "twist")
"""The order of every `axis=3` of joint angles."""

FINGERS: Final[tuple[str, ...]] = ("thumb", "index", "middle", "ring", "little")
"""The order of fingers in the landmarks."""

LANDMARKS: Final[tuple[str, ...]] = (
    "wrist",
    "thumb CMC",
    "thumb MCP",
    "thumb IP",
    "thumb tip",
    *(f"{finger} {part}" for finger in FINGERS[1:] for part in ("MCP", "PIP", "DIP", "tip")),
)
"""The 21 landmarks in FreiHAND's order."""

LANDMARK_OF_JOINT: Final[tuple[int, ...]] = tuple(LANDMARKS.index(name) for name in JOINTS)
"""Landmark index of each of the 16 joints."""

JOINT_OF_LANDMARK: Final[dict[int, int]] = {
    landmark: joint for joint, landmark in enumerate(LANDMARK_OF_JOINT)
}
"""Joint index by landmark index; the five tips have no joint."""

TIPS: Final[tuple[int, ...]] = (4, 8, 12, 16, 20)
"""Landmark indices of the fingertips, thumb first."""

LANDMARK_PARENTS: Final[tuple[int, ...]] = (
    -1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19,
)  # fmt: skip
"""Parent of each landmark; the 20 pairs are the bones that are drawn and measured."""

ROOT_JOINT: Final[int] = JOINTS.index("middle MCP")
"""Joint at the origin of the hand's frame, which is FreiHAND's root too."""

ROOT_LANDMARK: Final[int] = LANDMARKS.index("middle MCP")
"""Landmark index of `ROOT_JOINT`."""

_HO3D: Final = (*JOINTS, "thumb tip", "index tip", "middle tip", "ring tip", "little tip")
_KNOWN: Final = (*JOINTS, "thumb tip", "index tip", "middle tip", "little tip", "ring tip")
_DART: Final = (*JOINTS, "index tip", "middle tip", "little tip", "ring tip", "thumb tip")
_TIP_FIRST: Final = tuple(
    name for finger in range(5) for name in reversed(LANDMARKS[1 + 4 * finger : 5 + 4 * finger])
)

LANDMARK_ORDERS: Final[dict[str, tuple[str, ...]]] = {
    "freihand": LANDMARKS,
    "ho3d": _HO3D,
    "known_hand": _KNOWN,
    "dart": _DART,
    "rhd": ("wrist", *_TIP_FIRST),
    "interhand": (*_TIP_FIRST, "wrist"),
}
"""The landmark names of each convention in its own order."""


def landmark_permutation(source: str, target: str) -> tuple[int, ...]:
    """Indices such that `landmarks_target = landmarks_source[indices]`.

    Args:
        source: Convention of the given landmarks, a key of `LANDMARK_ORDERS`.
        target: Convention to convert to, a key of `LANDMARK_ORDERS`.

    Raises:
        ValueError: A convention is unknown.
    """
    for name in (source, target):
        if name not in LANDMARK_ORDERS:
            raise ValueError(
                f"Unknown landmark order {name!r}; known orders are {sorted(LANDMARK_ORDERS)}."
            )
    return tuple(LANDMARK_ORDERS[source].index(name) for name in LANDMARK_ORDERS[target])
