"""Eq. 4: no part of the hand is inside another one."""

import copy
import math

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from hand_recon.data.synthetic.gestures import gesture_library
from hand_recon.data.synthetic.unnatural import sample_unnatural_pose
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import ARTICULATED, JOINTS
from hand_recon.knowledge.penetration.closed_parts import (
    PALM_PART,
    PARTS,
    ClosedParts,
    closed_parts,
    geodesic_distances,
)
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.speed.published import depth_by_definition as reference
from tests.support.random_surfaces import random_vertices
from tests.support.tolerance import BATCH_SHAPES, assert_close

Array = NDArray[np.float64]
NEAR = 0.02


@pytest.fixture(scope="module")
def parts(hand: HandModel) -> ClosedParts:
    return closed_parts(hand)


@pytest.fixture(scope="module")
def geodesics(hand: HandModel) -> Array:
    return geodesic_distances(hand.template.double().numpy(), hand.faces.numpy())


@pytest.fixture(scope="module")
def physics(hand: HandModel) -> NonPenetration:
    return NonPenetration(hand)


def gesture(hand: HandModel, name: str, **bends: tuple[float, float, float]) -> Tensor:
    """Vertices of a gesture on the mean hand, with some fingers bent otherwise, degrees."""
    (found,) = (entry for entry in gesture_library() if entry.name == name)
    angles = torch.from_numpy(found.joint_angles).float()
    for finger, degrees in bends.items():
        first = ARTICULATED.index(f"{finger} MCP")
        angles[first : first + 3, 0] = torch.tensor(degrees).deg2rad()
    return hand(angles, torch.zeros(10)).vertices


def test_a_fingertip_pushed_nine_millimetres_into_the_palm_is_that_deep(
    hand: HandModel, physics: NonPenetration, parts: ClosedParts
) -> None:
    vertices = hand(hand.neutral_angles(), torch.zeros(10)).vertices
    tip = int(hand.landmark_regressor[12, :778].argmax())
    palm = trimesh.Trimesh(
        vertices.numpy(), parts.skin[parts.part_of_face == PALM_PART], process=False
    )
    middle = vertices[hand.wrist_ring].mean(dim=0).lerp(vertices[tip], 0.3).numpy()
    front, _, face = palm.ray.intersects_location([middle], [[0, -1, 0]], multiple_hits=False)
    inwards = -palm.face_normals[face[0]]
    for depth in (0.003, 0.009):
        pushed = vertices.clone()
        pushed[tip] = torch.from_numpy(front[0] + depth * inwards).float()
        assert float(physics.depths(pushed)[tip]) == pytest.approx(depth, abs=2e-4)
    others = physics(pushed) - (physics.depths(pushed)[tip] - 0.006)
    assert float(others) >= -1e-6


def test_one_finger_through_another_costs_what_its_vertices_are_too_deep(
    hand: HandModel, physics: NonPenetration
) -> None:
    vertices = gesture(hand, "flat")
    one, other = (PARTS.index(JOINTS.index(f"{finger} PIP")) for finger in ("index", "middle"))
    members = {
        part: np.unique(hand.faces[closed_parts(hand).part_of_face == part])
        for part in (one, other)
    }
    shift = vertices[members[other]].mean(dim=0) - vertices[members[one]].mean(dim=0)
    together = vertices.clone()
    together[members[one]] += 0.5 * shift
    depths = physics.depths(together)
    deep = depths[depths > 0.006]
    assert len(deep) > 0
    assert_close(physics(together), (deep - 0.006).sum())
    assert float(physics(vertices)) == 0


def test_a_fist_is_natural_and_a_fist_through_the_palm_is_not(
    hand: HandModel, physics: NonPenetration
) -> None:
    assert float(physics(gesture(hand, "fist"))) == 0
    deeper = [
        float(physics(gesture(hand, "fist", ring=(bend, bend + 4, 60)))) for bend in (95, 105, 115)
    ]
    assert 0 < deeper[0] < deeper[1] < deeper[2]


def test_no_gesture_of_the_library_penetrates(hand: HandModel, physics: NonPenetration) -> None:
    angles = torch.from_numpy(np.stack([entry.joint_angles for entry in gesture_library()]))
    vertices = hand(angles.float(), torch.zeros(len(angles), 10)).vertices
    names = [entry.name for entry in gesture_library()]
    found = physics(vertices) > 0
    assert [name for name, bad in zip(names, found.tolist(), strict=True) if bad] == []


def test_most_deliberate_penetrations_are_caught(hand: HandModel, physics: NonPenetration) -> None:
    random = np.random.default_rng(0)
    poses = [sample_unnatural_pose(random, "penetrating").joint_angles for _ in range(100)]
    vertices = hand(torch.tensor(np.stack(poses)).float(), torch.zeros(100, 10)).vertices
    assert float((physics(vertices) > 0).float().mean()) > 0.7


def test_agrees_with_the_definition_written_out(
    hand: HandModel, physics: NonPenetration, parts: ClosedParts, geodesics: Array
) -> None:
    vertices = random_vertices(hand, 5)
    expected = np.stack(
        [reference.depths(one.double().numpy(), parts, geodesics, NEAR) for one in vertices]
    )
    assert (expected > 0.006).any(axis=1).sum() >= 2
    assert_close(physics.depths(vertices), torch.tensor(expected))
    excess = np.maximum(expected - 0.006, 0).sum(axis=1)
    assert_close(physics(vertices), torch.tensor(excess))


def test_the_gradient_is_that_of_the_definition(
    hand: HandModel, parts: ClosedParts, geodesics: Array
) -> None:
    exact = NonPenetration(copy.deepcopy(hand).double())
    vertices = random_vertices(hand, 1, spread=0.7)[0].double().requires_grad_()
    exact(vertices).backward()
    assert vertices.grad is not None

    def total(moved: Array) -> float:
        return float(np.maximum(reference.depths(moved, parts, geodesics, NEAR) - 0.006, 0).sum())

    direction = torch.randn(778, 3, dtype=torch.float64)
    step = 1e-7 * direction.numpy()
    start = vertices.detach().numpy()
    slope = (total(start + step) - total(start - step)) / 2e-7
    assert abs(slope) > 0.1
    assert float((vertices.grad * direction).sum()) == pytest.approx(slope, rel=1e-4)


def test_gradient_with_respect_to_the_pose_matches_finite_differences(hand: HandModel) -> None:
    double = copy.deepcopy(hand).double()
    exact = NonPenetration(double)
    angles = 0.6 * torch.randn(6, 15, 3, dtype=torch.float64)
    shape = torch.zeros(1, 10, dtype=torch.float64)
    angles = angles[exact(double(angles, shape.expand(6, 10)).vertices) > 1e-4][:2]
    assert len(angles) == 2
    # One by one: a change of one hand's angles need not be followed through the other.
    for alone in angles.split(1):
        alone.requires_grad_()
        assert torch.autograd.gradcheck(lambda a: exact(double(a, shape).vertices), alone)


def test_the_gradient_moves_contacts_apart_and_nothing_else(
    hand: HandModel, physics: NonPenetration
) -> None:
    vertices = random_vertices(hand, 4).requires_grad_()
    physics(vertices).sum().backward()
    assert vertices.grad is not None
    contacts = physics.contacts(vertices.detach(), 0.006)
    touched = torch.zeros(4, 778, dtype=torch.bool)
    touched[contacts.hand, contacts.vertex] = True
    touched[contacts.hand[:, None], contacts.corners] = True
    moved = vertices.grad.norm(dim=-1) > 0
    assert bool(moved.any())
    assert not bool((moved & ~touched).any())
    # The gradients add up to zero: the hand as a whole does not move.
    assert float(vertices.grad.sum(dim=1).abs().max()) < 1e-4


def test_descent_takes_a_finger_out_of_the_palm(hand: HandModel, physics: NonPenetration) -> None:
    (found,) = (entry for entry in gesture_library() if entry.name == "fist")
    angles = torch.from_numpy(found.joint_angles).float()
    first = ARTICULATED.index("ring MCP")
    angles[first : first + 3, 0] = torch.tensor([108.0, 112, 40]).deg2rad()
    angles.requires_grad_()
    optimiser = torch.optim.Adam([angles], lr=0.01)
    for step in range(60):
        loss = physics(hand(angles, torch.zeros(10)).vertices)
        if step == 0:
            assert loss.item() > 0.001
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert float(physics(hand(angles, torch.zeros(10)).vertices).detach()) == 0


@pytest.mark.parametrize("spread", [0.0, 0.6, 3.0])
def test_the_gradient_is_finite_for_every_pose(
    hand: HandModel, physics: NonPenetration, spread: float
) -> None:
    angles = (spread * torch.randn(8, 15, 3)).requires_grad_()
    loss = physics(hand(angles, torch.zeros(8, 10)).vertices)
    loss.sum().backward()
    assert angles.grad is not None
    assert torch.isfinite(loss).all()
    assert torch.isfinite(angles.grad).all()


@pytest.mark.parametrize("tolerance", [0.0, 0.006])
def test_the_gradient_is_finite_for_hands_that_are_no_hands(
    hand: HandModel, tolerance: float
) -> None:
    physics = NonPenetration(hand, tolerance=tolerance)
    strange = torch.stack(
        [
            torch.zeros(778, 3),
            hand.template * torch.tensor([1.0, 0, 1]),
            0.05 * torch.randn(778, 3),
            1e3 * hand.template,
            -hand.template,
        ]
    ).requires_grad_()
    loss = physics(strange)
    loss.sum().backward()
    assert strange.grad is not None
    assert torch.isfinite(loss).all()
    assert torch.isfinite(strange.grad).all()
    assert loss[2].item() > 0


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_serves_any_batch_and_each_hand_for_itself(
    hand: HandModel, physics: NonPenetration, shape: tuple[int, ...]
) -> None:
    vertices = random_vertices(hand, math.prod(shape)).view(*shape, 778, 3)
    loss, depths = physics(vertices), physics.depths(vertices)
    assert loss.shape == shape
    assert depths.shape == (*shape, 778)
    one_by_one = torch.stack([physics(one) for one in vertices.view(-1, 778, 3)])
    assert_close(loss.flatten(), one_by_one)


def test_more_hands_than_are_bounded_at_once_keep_their_order(
    hand: HandModel, physics: NonPenetration
) -> None:
    vertices = torch.cat([hand.template.expand(70, 778, 3), random_vertices(hand, 3, spread=0.9)])
    assert_close(physics(vertices)[70:], physics(vertices[70:]))
    assert (physics(vertices)[:70] == 0).all()
    assert physics(vertices[:0]).shape == (0,)


def test_the_loss_does_not_care_where_the_hand_is(hand: HandModel, physics: NonPenetration) -> None:
    vertices = random_vertices(hand, 6)
    turn, _ = torch.linalg.qr(torch.randn(3, 3))
    turn = turn * torch.linalg.det(turn)
    placed = vertices @ turn.T + torch.tensor([0.05, -0.02, 0.6])
    torch.testing.assert_close(physics(placed), physics(vertices), rtol=1e-3, atol=1e-6)


def test_skin_that_is_near_along_the_surface_is_a_fold(hand: HandModel) -> None:
    vertices = random_vertices(hand, 6)
    losses = [
        NonPenetration(hand, geodesic=near)(vertices).sum() for near in (0.0, 0.02, 0.06, 1.0)
    ]
    assert losses[0] >= losses[1] > losses[2] > losses[3] == 0


def test_nothing_of_it_is_saved_and_all_of_it_moves(hand: HandModel) -> None:
    physics = NonPenetration(hand)
    assert physics.state_dict() == {}
    assert {buffer.device.type for buffer in physics.to("meta").buffers()} == {"meta"}


def test_lengths_that_are_none_are_refused(hand: HandModel) -> None:
    with pytest.raises(ValueError, match=r"cannot be negative, found 0.02 and -0.1"):
        NonPenetration(hand, tolerance=-0.1)
