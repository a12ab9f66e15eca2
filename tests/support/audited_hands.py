"""Hands for the tests of audits: poses of the gesture library, as angles or as points."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from hand_recon.data.synthetic.gestures import sample_pose
from hand_recon.data.synthetic.unnatural import sample_unnatural_pose
from hand_recon.hand.axis_angle import axis_angle_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, AXES
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.plausibility.audit import Audit, audited
from hand_recon.plausibility.findings import Knowledge
from hand_recon.plausibility.given_hands import GivenHands, of_points
from hand_recon.plausibility.posed_hands import HandModels
from hand_recon.plausibility.verdicts import Limits
from hand_recon.schema import HandParameters

MIRROR = torch.tensor([-1.0, 1.0, 1.0])


def natural_angles(count: int, seed: int = 0) -> Float[Tensor, "hand joint=15 axis=3"]:
    """Natural poses, radians."""
    random = np.random.default_rng(seed)
    return torch.from_numpy(np.stack([sample_pose(random) for _ in range(count)])).float()


def unnatural_angles(kind: str, count: int, seed: int = 0) -> Float[Tensor, "hand joint=15 axis=3"]:
    """Poses with one error of a kind, radians."""
    random = np.random.default_rng(seed)
    poses = [sample_unnatural_pose(random, kind).joint_angles for _ in range(count)]
    return torch.from_numpy(np.stack(poses)).float()


def bent(**degrees: float) -> Float[Tensor, "hand=1 joint=15 axis=3"]:
    """A straight hand with some angles given, such as `index_PIP_bend=110`, radians."""
    angles = torch.zeros(1, 15, 3)
    for name, value in degrees.items():
        joint, axis = name.rsplit("_", 1)
        angles[0, ARTICULATED.index(joint.replace("_", " ")), AXES.index(axis)] = value
    return angles.deg2rad()


def parameters_of(angles: Tensor, seed: int = 0, spread: float = 0.5) -> HandParameters:
    """Hands with these angles, of random shapes, anywhere."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    count = len(angles)
    rotation = axis_angle_to_rotation(normal(count, 3))
    return HandParameters(angles, spread * normal(count, 10), rotation, normal(count, 3))


def points_of(
    hand: HandModel, angles: Tensor, seed: int = 0
) -> Float[Tensor, "hand landmark=21 3"]:
    """Landmarks of right hands with these angles, metres."""
    return hand.to_camera(parameters_of(angles, seed)).landmarks


def given_angles(angles: Tensor, seed: int = 0) -> GivenHands:
    """Right open hands with these angles, without points."""
    count = len(angles)
    given = of_points(torch.full((count, 21, 3), torch.nan), "angles", left=[False] * count)
    return replace(given, parameters=parameters_of(angles, seed), hand_models=("open",) * count)


@cache
def models_of(hand: HandModel) -> HandModels:
    """The open hand's models, with its surface prepared once."""
    return HandModels.of(hand)


def audit_of(
    given: GivenHands, hand: HandModel, ranges: str = "literature", **limits: float
) -> Audit:
    """An audit with the open hand."""
    models = models_of(hand)
    knowledge = Knowledge(load_ranges(ranges, hand.rest_angles))
    return audited(given, models, knowledge, Limits(**limits))  # type: ignore[arg-type]


def row_of(audit: Audit, joint: str, axis: str) -> dict[str, object]:
    """A joint's row of an audit."""
    rows: Sequence[dict[str, object]] = audit.joints()
    return next(row for row in rows if (row["joint"], row["axis"]) == (joint, axis))
