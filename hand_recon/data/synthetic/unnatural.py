"""Unnatural poses: sampled gestures with one finger made impossible, to test scores of plausibility."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.gestures import BEND, SPLAY, TWIST, sample_pose
from hand_recon.hand.skeleton import ARTICULATED, FINGERS

Angles = Float[np.ndarray, "joint=15 axis=3"]


@dataclass(frozen=True)
class UnnaturalPose:
    """Natural pose with one error."""

    kind: str
    """Kind of error, a key of `KINDS`."""
    finger: str
    """Finger with the error."""
    joint_angles: Angles
    """Bend, splay and twist from the anatomical neutral, radians."""


def _joints(finger: str) -> list[int]:
    return [i for i, name in enumerate(ARTICULATED) if name.startswith(finger)]


def _hyper_bent(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """Bend a middle or distal joint backwards by 40–80°."""
    joint = _joints(finger)[random.integers(1, 3)]
    angles[joint, BEND] = -np.radians(random.uniform(40, 80))


def _over_bent(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """Bend a distal joint by 115–150°, into its own finger."""
    angles[_joints(finger)[2], BEND] = np.radians(random.uniform(115, 150))


def _twisted(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """Twist a bone about its own axis by 40–80°."""
    joint = _joints(finger)[random.integers(0, 3)]
    angles[joint, TWIST] = random.choice([-1, 1]) * np.radians(random.uniform(40, 80))


def _sideways(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """Bend a middle or distal joint sideways by 35–70°."""
    joint = _joints(finger)[random.integers(1, 3)]
    angles[joint, SPLAY] = random.choice([-1, 1]) * np.radians(random.uniform(35, 70))


def _penetrating(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """Splay a straight finger into its neighbour, or bend a finger through the palm."""
    root, middle, last = _joints(finger)
    if random.random() < 0.5 and finger != "thumb":
        angles[[root, middle, last], BEND] = np.radians([108, 112, 30])
        return
    inward = 1 if finger in ("ring", "little") else -1
    angles[[root, middle, last], BEND] = np.radians([25, 5, 0])
    angles[root, SPLAY] = inward * np.radians(random.uniform(40, 55))


KINDS: Final[dict[str, Callable[[np.random.Generator, Angles, str], None]]] = {
    "hyper_bent": _hyper_bent,
    "over_bent": _over_bent,
    "twisted": _twisted,
    "sideways": _sideways,
    "penetrating": _penetrating,
}
"""Functions that add each kind of error to the joint angles, in place."""


def sample_unnatural_pose(random: np.random.Generator, kind: str | None = None) -> UnnaturalPose:
    """Sample a gesture and add one error to one finger.

    Args:
        random: Source of randomness.
        kind: A key of `KINDS`; random if None.

    Raises:
        ValueError: The kind is unknown.
    """
    if kind is not None and kind not in KINDS:
        raise ValueError(f"Unknown kind of unnatural pose {kind!r}; choose one of {sorted(KINDS)}.")
    chosen = kind or str(random.choice(sorted(KINDS)))
    finger = str(random.choice(FINGERS))
    angles = sample_pose(random)
    KINDS[chosen](random, angles, finger)
    return UnnaturalPose(chosen, finger, angles)
