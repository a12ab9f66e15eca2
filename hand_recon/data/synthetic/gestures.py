"""Natural poses: mixtures of named gestures and grasps, with noise.

Each family of gestures has its source in `gestures.yaml`. The poses do not depend on any table of ranges of
motion, so priors on ranges can be tested on them.
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
"""Noise of a DIP joint over that of its PIP joint; one tendon bends both (Sec. 3.2)."""
_HINGES: Final = [i for i, joint in enumerate(ARTICULATED) if joint.endswith(("PIP", "DIP"))]
_OVERSTRETCHED: Final = np.radians(-5.0)
"""Least bend of a PIP or DIP joint in a natural pose, radians."""


@dataclass(frozen=True)
class Gesture:
    """One named pose of the library."""

    name: str
    """Name, unique in the library."""
    family: str
    """Family, which has a source in `gestures.yaml`."""
    held_out: bool
    """True for gestures of the test split only."""
    joint_angles: Float[np.ndarray, "joint=15 axis=3"]
    """Bend, splay and twist from the anatomical neutral, radians."""


@cache
def gesture_library() -> tuple[Gesture, ...]:
    """Read all gestures of `gestures.yaml`.

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
        raise ValueError(
            f"gestures.yaml holds out {sorted(unknown)}, which it does not define; use the names of "
            "its gestures."
        )
    return library


def _angles(
    name: str, row: list[object], table: dict[str, dict[str, list[float]]]
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Joint angles of one row of the library."""
    if len(row) not in (5, 6):
        raise ValueError(
            f"Gesture {name!r} has {len(row)} entries; expected five fingers, or five fingers and the splays."
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
    """Angles of an entry, which is a word or a list of numbers."""
    angles = words.get(cell) if isinstance(cell, str) else cell
    if not isinstance(angles, list) or len(angles) != length:
        raise ValueError(
            f"Gesture {name!r} has the entry {cell!r}; expected {length} numbers or one of {sorted(words)}."
        )
    return tuple(float(angle) for angle in angles)


def sample_pose(
    random: np.random.Generator, *, held_out: bool = False, noise: float = 4.0
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Draw a weighted mean of one, two or three gestures of one split, with noise.

    Args:
        random: Source of randomness.
        held_out: True draws from the test split's gestures, False from training's.
        noise: Standard deviation of the noise on bends, degrees; on splays it is half as large.

    Returns:
        Bend, splay and twist from the anatomical neutral, radians.
    """
    pool = _pool(held_out)
    count = int(random.choice([1, 2, 3], p=[0.35, 0.5, 0.15]))
    chosen = [pool[i].joint_angles for i in random.choice(len(pool), size=count, replace=False)]
    weights = random.dirichlet(np.full(count, 0.7))
    angles = np.einsum("g,gja->ja", weights, np.stack(chosen))
    if count > 1 and random.random() < 0.2:
        angles = _fingers_apart(random, chosen)
    angles = angles + _noise(random, np.radians(noise))
    # PIP and DIP joints overstretch by a few degrees; the noise must not exceed that.
    angles[_HINGES, BEND] = np.maximum(angles[_HINGES, BEND], _OVERSTRETCHED)
    return angles


@cache
def _pool(held_out: bool) -> tuple[Gesture, ...]:
    """Gestures of the test split, or of the other splits."""
    return tuple(gesture for gesture in gesture_library() if gesture.held_out == held_out)


def _fingers_apart(
    random: np.random.Generator, chosen: list[Float[np.ndarray, "joint=15 axis=3"]]
) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Take each finger from a randomly chosen gesture, as in a change between two gestures."""
    angles = np.empty_like(chosen[0])
    for finger in FINGERS:
        joints = [i for i, name in enumerate(ARTICULATED) if name.startswith(finger)]
        angles[joints] = chosen[random.integers(len(chosen))][joints]
    return angles


def _noise(random: np.random.Generator, deviation: float) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Draw noise on the angles, correlated between fingers and between a PIP and its DIP."""
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
