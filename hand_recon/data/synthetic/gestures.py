"""Natural poses: a library of named gestures and grasps, mixed and perturbed.

The poses are natural because people make them, each family with its source in `gestures.yaml`. No range
table enters, so that what a prior says about ranges can be tested on them.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np
import yaml
from jaxtyping import Float

from hand_recon.hand.skeleton import ARTICULATED, FINGERS

BEND, SPLAY, TWIST = 0, 1, 2
_FINGER_JOINTS: Final = ("MCP", "PIP", "DIP")
_THUMB_ANGLES: Final = (
    ("thumb CMC", BEND), ("thumb CMC", SPLAY), ("thumb MCP", BEND), ("thumb IP", BEND),
)  # fmt: skip
DIP_FOLLOWS_PIP: Final = 2 / 3
"""Noise on a PIP joint moves its DIP joint by this much: one tendon bends both (Sec. 3.2)."""
_OVERSTRETCHED: Final = np.radians(-5.0)
"""Least bend of a PIP or DIP joint in a natural pose."""


@dataclass(frozen=True)
class Gesture:
    """One named pose."""

    name: str
    """Unique in the library."""
    family: str
    """Where it comes from."""
    held_out: bool
    """Whether only the test split sees it."""
    joint_angles: Float[np.ndarray, "joint=15 axis=3"]
    """Bend, splay and twist from the anatomical neutral, radians."""


@cache
def gesture_library() -> tuple[Gesture, ...]:
    """Every gesture of `gestures.yaml`.

    Raises:
        ValueError: An entry is malformed or a held-out name does not exist.
    """
    text = (files("hand_recon.data.synthetic") / "gestures.yaml").read_text(encoding="utf-8")
    table = yaml.safe_load(text)
    held_out = set(table["held_out"])
    library = tuple(
        Gesture(name, family, name in held_out, _angles(name, row, table))
        for family, entry in table["families"].items()
        for name, row in entry["gestures"].items()
    )
    unknown = held_out - {gesture.name for gesture in library}
    if unknown:
        raise ValueError(f"gestures.yaml holds out {sorted(unknown)}, which it does not define.")
    return library


def _angles(
    name: str, row: list[object], table: dict[str, dict[str, list[float]]]
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Joint angles of one row of the library."""
    if len(row) not in (5, 6):
        raise ValueError(
            f"Gesture {name!r} has {len(row)} entries; expected five fingers and splays."
        )
    degrees = np.zeros((15, 3))
    thumb = _looked_up(name, row[0], table["thumbs"], 4)
    for (joint, axis), value in zip(_THUMB_ANGLES, thumb, strict=True):
        degrees[ARTICULATED.index(joint), axis] = value
    splays = _looked_up(name, row[5], table["splays"], 4) if len(row) == 6 else (0.0,) * 4
    for finger, cell, splay in zip(FINGERS[1:], row[1:5], splays, strict=True):
        bends = _looked_up(name, cell, table["fingers"], 3)
        for joint, bend in zip(_FINGER_JOINTS, bends, strict=True):
            degrees[ARTICULATED.index(f"{finger} {joint}"), BEND] = bend
        degrees[ARTICULATED.index(f"{finger} MCP"), SPLAY] = splay
    return np.radians(degrees)


def _looked_up(
    name: str, cell: object, words: dict[str, list[float]], length: int
) -> tuple[float, ...]:
    """The angles a word or a list stands for."""
    angles = words.get(cell) if isinstance(cell, str) else cell
    if not isinstance(angles, list) or len(angles) != length:
        raise ValueError(
            f"Gesture {name!r} has the entry {cell!r}; expected {length} numbers or one of {sorted(words)}."
        )
    return tuple(float(angle) for angle in angles)


def sample_pose(
    random: np.random.Generator, *, held_out: bool = False, noise: float = 4.0
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """A pose on the way between one, two or three gestures of one split.

    Args:
        random: Source of randomness.
        held_out: Draw from the test split's gestures instead of training's.
        noise: Standard deviation of the noise on bends, degrees; splays get half of it.

    Returns:
        Bend, splay and twist from the anatomical neutral, radians.
    """
    pool = [gesture for gesture in gesture_library() if gesture.held_out == held_out]
    count = int(random.choice([1, 2, 3], p=[0.35, 0.5, 0.15]))
    chosen = [pool[i].joint_angles for i in random.choice(len(pool), size=count, replace=False)]
    weights = random.dirichlet(np.full(count, 0.7))
    angles = np.einsum("g,gja->ja", weights, np.stack(chosen))
    if count > 1 and random.random() < 0.2:
        angles = _fingers_apart(random, chosen)
    angles = angles + _noise(random, np.radians(noise))
    # Fingers overstretch a little at their hinges, and noise must not make it much.
    hinges = [i for i, joint in enumerate(ARTICULATED) if joint.endswith(("PIP", "DIP"))]
    angles[hinges, BEND] = np.maximum(angles[hinges, BEND], _OVERSTRETCHED)
    return angles


def _fingers_apart(
    random: np.random.Generator, chosen: list[Float[np.ndarray, "joint=15 axis=3"]]
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Each finger from a gesture of its own, as when one finger leads a change of grip."""
    angles = np.empty_like(chosen[0])
    for finger in FINGERS:
        joints = [i for i, name in enumerate(ARTICULATED) if name.startswith(finger)]
        angles[joints] = chosen[random.integers(len(chosen))][joints]
    return angles


def _noise(random: np.random.Generator, deviation: float) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Small departures that neighbouring fingers share and that a DIP takes over from its PIP."""
    noise = np.zeros((15, 3))
    shared = random.normal(scale=deviation * 0.7, size=2)
    for finger in FINGERS[1:]:
        first = ARTICULATED.index(f"{finger} MCP")
        own = random.normal(scale=deviation * 0.7, size=3)
        noise[first, BEND] = shared[0] + own[0]
        noise[first + 1, BEND] = shared[1] + own[1]
        noise[first + 2, BEND] = DIP_FOLLOWS_PIP * noise[first + 1, BEND] + 0.3 * own[2]
        noise[first, [SPLAY, TWIST]] = random.normal(scale=[deviation * 0.5, deviation * 0.3])
    for joint, axis in _THUMB_ANGLES:
        noise[ARTICULATED.index(joint), axis] = random.normal(scale=deviation * 0.8)
    noise[ARTICULATED.index("thumb CMC"), TWIST] = random.normal(scale=deviation * 0.3)
    return noise
