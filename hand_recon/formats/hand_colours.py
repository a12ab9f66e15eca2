"""Colours that tell the hands of a clip apart."""

from collections.abc import Sequence
from typing import Final

from hand_recon.motion.trajectory import Trajectory
from hand_recon.visualization.hand_overlay import HAND_COLOURS

_FURTHER: Final = (
    (230.0, 150.0, 60.0), (180.0, 120.0, 210.0), (215.0, 95.0, 110.0), (70.0, 175.0, 175.0),
    (200.0, 180.0, 60.0), (140.0, 140.0, 140.0),
)  # fmt: skip


def hand_colours(trajectories: Sequence[Trajectory]) -> list[tuple[float, float, float]]:
    """Choose a colour for each hand, RGB, 0–255.

    The first left and the first right hand have the colours of their sides in overlays; further hands have
    others, which repeat after six.
    """
    free = dict(HAND_COLOURS)
    colours, further = [], 0
    for trajectory in trajectories:
        if trajectory.side in free:
            colours.append(free.pop(trajectory.side))
        else:
            colours.append(_FURTHER[further % len(_FURTHER)])
            further += 1
    return colours
