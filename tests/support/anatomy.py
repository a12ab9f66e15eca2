"""Ranges in round numbers, poses in degrees and single rules, for the tests of Eq. 2-3."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.functional_anatomy import FunctionalAnatomy
from hand_recon.knowledge.ranges import RangeOfMotion

RULES = ("splay_by_bend", "bend_by_splay", "pip_by_dip", "thumb_cmc")
Degrees = dict[tuple[str, str], float]
NO_RULE = FunctionalAnatomy(
    splay_by_bend=False, bend_by_splay=False, pip_by_dip=False, thumb_cmc=False
)
FINGER_JOINTS = {"MCP": {"bend": (-20, 80), "splay": (-30, 10)}, "PIP": {"bend": (-10, 100)}}


def angle_index(joint: str, axis: str) -> tuple[int, int]:
    """Row and column of an angle among the 15×3 joint angles."""
    return ARTICULATED.index(joint), AXES.index(axis)


def only(rule: str, variant: str = "paper") -> FunctionalAnatomy:
    """Functional anatomy with one rule alone."""
    return replace(NO_RULE, variant=variant, **{rule: True})


def pose(degrees: Degrees) -> Tensor:
    """Joint angles in radians, zero except for the given ones."""
    angles = torch.zeros(15, 3, dtype=torch.float64)
    for (joint, axis), value in degrees.items():
        angles[angle_index(joint, axis)] = math.radians(value)
    return angles


def round_ranges() -> RangeOfMotion:
    """Ranges in degrees: MCP bend −20 to 80, splay −30 to 10; PIP −10 to 100; CMC −20 to 40, −30 to 12."""
    bounds = torch.zeros(2, 15, 3, dtype=torch.float64)
    for joint in ARTICULATED:
        rows = {"bend": (0, 80)}
        if joint == "thumb CMC":
            rows = {"bend": (-20, 40), "splay": (-30, 12)}
        elif not joint.startswith("thumb"):
            rows = FINGER_JOINTS.get(joint.split()[1], rows)
        for axis, ends in rows.items():
            bounds[(slice(None), *angle_index(joint, axis))] = torch.tensor(
                ends, dtype=torch.float64
            )
    bounds = bounds.deg2rad()
    return RangeOfMotion(bounds[0], bounds[1])
