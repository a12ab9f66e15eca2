"""Poses that no living hand takes, made on purpose: what an audit must catch."""

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
    """A natural pose with one thing wrong."""

    kind: str
    """A key of `KINDS`."""
    finger: str
    """Which finger it was done to."""
    joint_angles: Angles
    """Bend, splay and twist from the anatomical neutral, radians."""


def _joints(finger: str) -> list[int]:
    return [i for i, name in enumerate(ARTICULATED) if name.startswith(finger)]


def _hyper_bent(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """A middle or last joint bent backwards by 40–80°."""
    joint = _joints(finger)[random.integers(1, 3)]
    angles[joint, BEND] = -np.radians(random.uniform(40, 80))


def _over_bent(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """A last joint bent by 115–150°, into its own finger."""
    angles[_joints(finger)[2], BEND] = np.radians(random.uniform(115, 150))


def _twisted(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """A bone turned about itself by 40–80°."""
    joint = _joints(finger)[random.integers(0, 3)]
    angles[joint, TWIST] = random.choice([-1, 1]) * np.radians(random.uniform(40, 80))


def _sideways(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """A hinge bent to the side by 35–70°."""
    joint = _joints(finger)[random.integers(1, 3)]
    angles[joint, SPLAY] = random.choice([-1, 1]) * np.radians(random.uniform(35, 70))


def _penetrating(random: np.random.Generator, angles: Angles, finger: str) -> None:
    """A straight finger pushed through its neighbour's place, or a fist pushed through the palm."""
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
"""What can be wrong, and what does it."""


def sample_unnatural_pose(random: np.random.Generator, kind: str | None = None) -> UnnaturalPose:
    """A sampled gesture with one finger spoilt.

    Args:
        random: Source of randomness.
        kind: A key of `KINDS`; any of them if not given.

    Raises:
        ValueError: There is no such kind.
    """
    if kind is not None and kind not in KINDS:
        raise ValueError(f"Unknown kind of unnatural pose {kind!r}; known are {sorted(KINDS)}.")
    chosen = kind or str(random.choice(sorted(KINDS)))
    finger = str(random.choice(FINGERS))
    angles = sample_pose(random)
    KINDS[chosen](random, angles, finger)
    return UnnaturalPose(chosen, finger, angles)
