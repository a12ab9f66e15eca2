"""Poses whose fingers move independently of each other, over the whole of their ranges.

Gestures cover what hands usually do; a network that has seen only these pulls every other pose to the
nearest of them. Here each finger is drawn alone, so that every combination of fingers occurs.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from hand_recon.data.synthetic.gestures import BEND, DIP_FOLLOWS_PIP, SPLAY, TWIST
from hand_recon.hand.skeleton import ARTICULATED, FINGERS

MCP_BEND: Final = (-20.0, 90.0)
"""Bend of an MCP joint, degrees, between a hand held back and a fist (AAOS)."""

PIP_BEND: Final = (-5.0, 105.0)
"""Bend of a PIP joint, degrees (AAOS 100, and some people's overstretch)."""

DIP_NOISE: Final = 8.0
"""Standard deviation of the bend of a DIP joint about `DIP_FOLLOWS_PIP` of its PIP joint, degrees."""

SPLAY_STRAIGHT: Final = 18.0
"""Largest splay of a straight finger, degrees; a bent one has less, down to a fifth."""

STRAIGHT_OR_CURLED: Final = 0.3
"""Share of fingers that are straight, and as many that are curled: fingers often rest at these ends."""

THUMB: Final = {
    ("thumb CMC", BEND): (-25.0, 40.0),
    ("thumb CMC", SPLAY): (-38.0, 10.0),
    ("thumb CMC", TWIST): (-8.0, 8.0),
    ("thumb MCP", BEND): (-8.0, 50.0),
    ("thumb IP", BEND): (-12.0, 70.0),
}
"""Ranges of the thumb, degrees, those of the library's gestures and some degrees more."""


def independent_pose(random: np.random.Generator) -> Float[np.ndarray, "joint=15 axis=3"]:
    """Draw every finger by itself.

    Args:
        random: Source of randomness.

    Returns:
        Bend, splay and twist from the anatomical neutral, radians.
    """
    degrees = np.zeros((15, 3))
    for finger in FINGERS[1:]:
        first = ARTICULATED.index(f"{finger} MCP")
        mcp, pip, dip = _bends(random)
        degrees[[first, first + 1, first + 2], BEND] = mcp, pip, dip
        freedom = 1 - 0.8 * np.clip(mcp, 0, 90) / 90
        degrees[first, SPLAY] = random.uniform(-1, 1) * SPLAY_STRAIGHT * freedom
        degrees[first, TWIST] = random.normal(scale=2.0)
    for (joint, axis), (low, high) in THUMB.items():
        degrees[ARTICULATED.index(joint), axis] = random.uniform(low, high)
    return np.radians(degrees)


def _bends(random: np.random.Generator) -> tuple[float, float, float]:
    """Bends of MCP, PIP and DIP of one finger, degrees."""
    kind = random.random()
    mcp = random.uniform(*MCP_BEND)
    pip = random.uniform(*PIP_BEND)
    if kind < STRAIGHT_OR_CURLED:
        mcp, pip = random.normal(5.0, 10.0), abs(random.normal(scale=8.0))
    elif kind < 2 * STRAIGHT_OR_CURLED:
        mcp, pip = random.uniform(40.0, 90.0), random.uniform(70.0, PIP_BEND[1])
    dip = DIP_FOLLOWS_PIP * pip + random.normal(scale=DIP_NOISE)
    return mcp, pip, float(np.clip(dip, -5.0, 80.0))
