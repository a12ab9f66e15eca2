"""Start poses of the fingers: for each finger the pose of a table that is nearest to the landmarks.

Given a placement of the palm, every finger is looked up alone. A finger that points towards the camera and
one that points away from it may look alike, so there is a second choice whose tip is at another depth.
"""

import functools
import itertools
import math
from dataclasses import dataclass, replace
from typing import Final, Self

import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.camera import project
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.second_order.unknowns import Unknowns
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES, FINGERS, LANDMARKS

KNUCKLE_BENDS: Final = {
    "finger": (0.0, 25.0, 50.0, 75.0),
    "thumb": (-12.0, 1.0, 14.0, 28.0),
}
"""Bend of the MCP, at the thumb of the CMC, degrees: spread over the range of motion."""

FURTHER_BENDS: Final = {
    "finger": ((5.0, 3.0), (35.0, 22.0), (65.0, 42.0), (95.0, 61.0)),
    "thumb": ((-7.0, -10.0), (13.0, 18.0), (32.0, 47.0), (52.0, 75.0)),
}
"""Bends of PIP and DIP, which bend together, at the thumb of MCP and IP, degrees."""

SPLAYS: Final = {
    "thumb": (-17.0, -9.0, -1.0),
    "index": (-6.0, 5.0, 16.0),
    "middle": (-7.0, 3.0, 14.0),
    "ring": (-20.0, -12.0, -4.0),
    "little": (-34.0, -20.0, -6.0),
}
"""Splay of the first joint, degrees."""

OTHER_DEPTH: Final = 0.02
"""Least difference of the depths of a fingertip in the two choices, metres."""


class FingerPoses:
    """Table of poses of every finger, with the landmarks of the mean hand in each of them.

    Args:
        hand: Hand model.
    """

    def __init__(self, hand: HandModel) -> None:
        self._poses = finger_table().to(hand.template)
        self._points = hand(self._poses, hand.template.new_zeros(len(self._poses), 10)).landmarks

    def nearest(self, start: Unknowns, seen: "Seen") -> tuple[Unknowns, Unknowns]:
        """Replace the joint angles of hands by those of the table that meet the landmarks best.

        Args:
            start: Placements of the palm.
            seen: The landmarks.

        Returns:
            The best pose of every finger; and the best of those with the fingertip at another depth.
        """
        placed = self._points @ start.root_rotation.mT[:, None]
        placed = placed + start.translation(seen.inverse)[:, None, None]
        pixels = project(placed.flatten(1, 2), seen.intrinsics).view(*placed.shape[:3], 2)
        off = (pixels - seen.target[:, None]).square() * seen.weights[:, None]
        costs, depths = off.sum(dim=-1), placed[..., 2]
        first, second = start.joint_angles.clone(), start.joint_angles.clone()
        for finger in FINGERS:
            landmarks = [place for place, name in enumerate(LANDMARKS) if name.startswith(finger)]
            joints = [place for place, name in enumerate(ARTICULATED) if name.startswith(finger)]
            cost = costs[:, :, landmarks].sum(dim=-1)
            best = cost.argmin(dim=1)
            first[:, joints] = self._poses[:, joints][best]
            reach = depths[:, :, landmarks[-1]] - depths[:, :, landmarks[0]]
            alike = (reach - reach.gather(1, best[:, None])).abs() < OTHER_DEPTH
            other = cost.masked_fill(alike, torch.inf).argmin(dim=1)
            second[:, joints] = self._poses[:, joints][other]
        return replace(start, joint_angles=first), replace(start, joint_angles=second)


@dataclass(frozen=True)
class Seen:
    """Landmarks of hands and their weights."""

    target: Float[Tensor, "hand landmark=21 2"]
    """Landmarks, pixels."""
    weights: Float[Tensor, "hand landmark=21 2"]
    """Weights of the squared residuals; zero where there is no landmark."""
    intrinsics: Float[Tensor, "hand 3 3"]
    """Camera matrices, pixels."""
    inverse: Float[Tensor, "hand 3 3"]
    """Their inverses."""

    @classmethod
    def of(cls, observation: Observation) -> Self:
        """Landmarks with the weights 1 / σ².

        Args:
            observation: The landmarks.
        """
        labelled = observation.labelled[..., None]
        return cls(
            observation.landmarks_2d.masked_fill(~labelled, 0.0),
            torch.exp(-2 * observation.log_sigma()) * labelled,
            observation.intrinsics,
            torch.linalg.inv(observation.intrinsics),
        )


@functools.cache
def finger_table() -> Float[Tensor, "pose joint=15 axis=3"]:
    """All combinations of bends and splays, the same number for every finger, radians."""
    count = len(KNUCKLE_BENDS["finger"]) * len(FURTHER_BENDS["finger"]) * len(SPLAYS["thumb"])
    poses = torch.zeros(count, len(ARTICULATED), len(AXES))
    bend, splay = AXES.index("bend"), AXES.index("splay")
    for finger in FINGERS:
        kind = "thumb" if finger == "thumb" else "finger"
        joints = [place for place, name in enumerate(ARTICULATED) if name.startswith(finger)]
        combined = itertools.product(KNUCKLE_BENDS[kind], FURTHER_BENDS[kind], SPLAYS[finger])
        for row, (knuckle, further, sideways) in enumerate(combined):
            poses[row, joints, bend] = torch.tensor([knuckle, *further]) * math.pi / 180
            poses[row, joints[0], splay] = math.radians(sideways)
    return poses
