"""Range of the thumb: Kapandji's opposition test (1986) as an optimisation."""

import math
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import ARTICULATED, JOINTS, LANDMARKS
from hand_recon.knowledge.ranges import load_ranges

CONTACT = 0.010
"""Largest distance of touching pads, metres; real pads deform by several millimetres, the mesh does not."""

HAND = open_hand()
RANGES = load_ranges("literature")


@dataclass(frozen=True)
class Search:
    """Best pose of the search."""

    distance: float
    """Distance from the thumb's pad to the target, metres."""
    facing: float
    """Cosine between the two outward normals; −1 for pads that face each other."""
    joint_angles: Tensor
    """Joint angles, radians."""


def _pad(finger: str) -> int:
    """Vertex in the middle of a finger's pad: palmar, 8 mm from its tip."""
    joint = JOINTS.index(f"{finger} IP" if finger == "thumb" else f"{finger} DIP")
    frame = HAND.frames[joint - 1]
    tip = HAND.landmarks_of(HAND.template, HAND.joints_template)[LANDMARKS.index(f"{finger} tip")]
    target = tip + 0.0045 * frame[:, 0] - 0.008 * frame[:, 1]
    own = HAND.skinning_weights[:, joint] > 0.8
    away = (HAND.template - target).norm(dim=-1)
    return int(torch.where(own, away, torch.inf).argmin())


def _skin_near(joint: str, distal: float, palmar: float) -> int:
    """Vertex nearest to an offset from a rotation centre along its segment's axes, metres."""
    index = JOINTS.index(joint)
    frame = HAND.frames[index - 1]
    target = HAND.joints_template[index] - distal * frame[:, 0] - palmar * frame[:, 1]
    return int((HAND.template - target).norm(dim=-1).argmin())


def _normal(vertices: Tensor, vertex: int) -> Tensor:
    """Outward normal of the triangles around a vertex."""
    corners = vertices[..., HAND.faces[(HAND.faces == vertex).any(dim=-1)], :]
    first, second = corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    return torch.nn.functional.normalize(torch.linalg.cross(first, second).sum(dim=-2), dim=-1)


def _reach(
    target: int, partner: str | None, max_bend: float = math.pi, face: float = 0.010
) -> Search:
    """Bring the thumb's pad as near to a vertex as the ranges allow, while one finger bends towards it.

    Args:
        target: The vertex to touch.
        partner: The finger that may move besides the thumb.
        max_bend: How far that finger may bend at any joint, radians.
        face: Weight of the pads' facing each other, metres.
    """
    free = torch.tensor([name.split()[0] in ("thumb", partner) for name in ARTICULATED])[:, None]
    upper = torch.where(
        torch.tensor([name.startswith("thumb") for name in ARTICULATED])[:, None],
        RANGES.upper, RANGES.upper.clamp(max=max_bend),
    )  # fmt: skip
    thumb = _pad("thumb")
    raw = 0.5 * torch.randn(6, 15, 3, generator=torch.Generator().manual_seed(0))
    raw = raw.requires_grad_()
    optimizer = torch.optim.Adam([raw], lr=0.12)
    for _ in range(130):
        angles = (RANGES.lower + (upper - RANGES.lower) * raw.sigmoid()) * free
        vertices = HAND(angles, torch.zeros(6, 10)).vertices
        distance = (vertices[:, thumb] - vertices[:, target]).norm(dim=-1)
        facing = (_normal(vertices, thumb) * _normal(vertices, target)).sum(dim=-1)
        effort = angles.square().sum(dim=(-2, -1))
        optimizer.zero_grad()
        cost = distance + face * facing + 0.0003 * effort
        cost.sum().backward()
        optimizer.step()
    best = int(cost.argmin())
    found = [value[best].detach() for value in (distance, facing, angles)]
    return Search(float(found[0]), float(found[1]), found[2])


@pytest.mark.parametrize("finger", ["index", "middle", "ring", "little"])
def test_the_thumbs_pad_touches_the_pad_of_every_fingertip(finger: str) -> None:
    """Kapandji's stages 3 to 6."""
    found = _reach(_pad(finger), finger)
    assert RANGES.contains(found.joint_angles)
    assert found.distance < CONTACT
    assert found.facing < -0.3


def test_the_thumb_reaches_the_base_of_the_little_finger() -> None:
    """Kapandji's stage 9, the little finger bent by no more than 60°."""
    crease = _skin_near("little MCP", distal=0.020, palmar=0.010)
    found = _reach(crease, "little", max_bend=math.radians(60), face=0.003)
    assert RANGES.contains(found.joint_angles)
    assert found.distance < CONTACT


@pytest.mark.parametrize(
    ("joint", "distal", "palmar"),
    [("middle MCP", 0.0, -0.012), ("little MCP", 0.0, -0.010), ("ring PIP", 0.0, -0.008)],
)
def test_the_thumb_cannot_reach_the_back_of_the_hand(
    joint: str, distal: float, palmar: float
) -> None:
    found = _reach(_skin_near(joint, distal, palmar), None, face=0.0)
    assert found.distance > 2 * CONTACT


def test_the_thumb_stays_on_its_side_of_the_little_finger() -> None:
    """The tip reaches no farther than the ulnar edge of the palm."""
    edge = HAND.template[HAND.skinning_weights[:, 0] > 0.5, 2].min() - HAND.joints_template[4, 2]
    random = torch.rand(2000, 15, 3, generator=torch.Generator().manual_seed(1))
    angles = RANGES.lower + (RANGES.upper - RANGES.lower) * random
    tips = HAND(angles, torch.zeros(2000, 10)).landmarks[:, LANDMARKS.index("thumb tip")]
    assert tips[:, 2].min() > edge - CONTACT


def test_bending_the_cmc_moves_the_tip_across_the_palm() -> None:
    rest, bent = HAND.neutral_angles(), HAND.neutral_angles()
    bent[ARTICULATED.index("thumb CMC"), 0] = 0.5
    tip = LANDMARKS.index("thumb tip")
    moved = HAND(bent, torch.zeros(10)).landmarks[tip] - HAND(rest, torch.zeros(10)).landmarks[tip]
    assert moved[2] < -0.03


def test_splaying_the_cmc_moves_the_tip_in_front_of_the_palm() -> None:
    rest, splayed = HAND.neutral_angles(), HAND.neutral_angles()
    splayed[ARTICULATED.index("thumb CMC"), 1] = 0.3
    tip = LANDMARKS.index("thumb tip")
    moved = (
        HAND(splayed, torch.zeros(10)).landmarks[tip] - HAND(rest, torch.zeros(10)).landmarks[tip]
    )
    assert moved[1] < -0.015


def test_the_thumbs_neutral_is_aligned_with_the_trapezium() -> None:
    """48° of flexion and 38° of abduction from the third metacarpal, Cooney et al. 1981."""
    posed = HAND(HAND.neutral_angles(), torch.zeros(10))
    third = torch.nn.functional.normalize(posed.joints[4] - posed.joints[0], dim=0)
    first = torch.nn.functional.normalize(posed.joints[14] - posed.joints[13], dim=0)
    cosine = math.cos(math.radians(48)) * math.cos(math.radians(38))
    assert float(third @ first) == pytest.approx(cosine, abs=0.01)
