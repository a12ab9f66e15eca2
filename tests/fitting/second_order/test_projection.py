"""Points as sums over joints, and their projections: the hand model's own, with autograd's derivatives."""

import pytest
import torch

from hand_recon.camera import project
from hand_recon.fitting.second_order.chain import (
    Skeleton,
    chain_points,
    chain_vertices,
    subtrees,
)
from hand_recon.fitting.second_order.projection import LandmarkProjection
from hand_recon.fitting.second_order.unknowns import COUNT, Unknowns
from hand_recon.hand.anatomical_axes import rotation
from hand_recon.hand.skeleton import JOINTS, LEVEL_ORDER
from tests.fitting.second_order.hands import double_hand, random_cameras, random_unknowns
from tests.support.tolerance import assert_close

SETS = pytest.mark.parametrize("landmark_set", ["knuckle", "mano"])


def test_a_subtree_holds_a_joint_and_all_that_it_moves() -> None:
    mask = subtrees()
    assert mask[0].all()
    names = [[JOINTS[j] for j in row.nonzero()[:, 0].tolist()] for row in mask]
    assert names[1] == ["index MCP", "index PIP", "index DIP"]
    assert names[14] == ["thumb MCP", "thumb IP"]
    assert sorted(LEVEL_ORDER) == list(range(16))


def test_the_axes_rotate_the_joint_that_they_belong_to() -> None:
    """A small change of an angle rotates the child segment about the axis by that change."""
    hand, count = double_hand(), 3
    skeleton, unknowns = Skeleton(hand), random_unknowns(count)
    before, axes = skeleton(unknowns.joint_angles, unknowns.root_rotation)
    small = 1e-6
    for place, joint in ((1, 1), (8, 8), (15, 15)):
        place = LEVEL_ORDER.index(joint)
        for axis in range(3):
            moved = unknowns.joint_angles.clone()
            moved[:, joint - 1, axis] += small
            after, _ = skeleton(moved, unknowns.root_rotation)
            first, second = (
                before[:, :, place].permute(2, 0, 1),
                after[:, :, place].permute(2, 0, 1),
            )
            turned = (second - first) @ first.mT / small
            found = torch.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], dim=-1)
            torch.testing.assert_close(found, axes[:, axis, place].mT, atol=1e-5, rtol=0)


def test_every_vertex_is_its_sum_over_the_joints() -> None:
    hand, unknowns = double_hand(), random_unknowns(2)
    points = chain_vertices(hand)
    eye = torch.eye(3, dtype=torch.float64).expand(2, 3, 3)
    orientations, _ = Skeleton(hand)(unknowns.joint_angles, eye)
    local = points.mean + torch.einsum("vjxs,hs->hvjx", points.shape_directions, unknowns.shape)
    summed = torch.einsum("xyjh,hvjy->hvx", orientations, local)
    assert_close(summed, hand(unknowns.joint_angles, unknowns.shape).vertices)


@SETS
def test_light_and_whole_hands_have_the_same_chains(landmark_set: str) -> None:
    hand = double_hand(landmark_set)
    light = hand.landmarks_only()
    whole, few = (chain_points(h, h.landmark_regressor) for h in (hand, light))
    assert_close(few.mean, whole.mean)
    assert_close(few.shape_directions, whole.shape_directions)


@SETS
def test_pixels_are_those_of_the_hand_model(landmark_set: str) -> None:
    hand, unknowns, cameras = double_hand(landmark_set), random_unknowns(4), random_cameras(4)
    inverse = torch.linalg.inv(cameras)
    found = LandmarkProjection(hand)(unknowns, cameras, inverse).pixels.permute(2, 1, 0)
    posed = hand.to_camera(unknowns.parameters(inverse))
    assert_close(found, project(posed.landmarks, cameras))


@SETS
@pytest.mark.parametrize("every_second", [False, True])
def test_the_jacobian_is_autograds(landmark_set: str, every_second: bool) -> None:
    hand, unknowns, cameras = double_hand(landmark_set), random_unknowns(3), random_cameras(3)
    inverse = torch.linalg.inv(cameras)
    free = torch.cat([torch.arange(0, 45, 2 if every_second else 1), torch.arange(45, COUNT)])
    projection = LandmarkProjection(hand, free)
    found = projection.jacobian(projection(unknowns, cameras, inverse), inverse)

    def pixels(step: torch.Tensor) -> torch.Tensor:
        posed = hand.to_camera(unknowns.moved(step).parameters(inverse))
        return project(posed.landmarks, cameras).permute(0, 2, 1).flatten(1).sum(dim=0)

    zero = torch.zeros(3, COUNT, dtype=torch.float64)
    expected = torch.autograd.functional.jacobian(pixels, zero).permute(1, 0, 2)[..., free]
    # The asset's axes are single precision, and so not quite orthonormal.
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=2e-5)
    assert float(expected.abs().amax(dim=(0, 1)).min()) > 1e-4  # Every unknown moves a landmark.


def test_a_step_moves_what_its_name_says() -> None:
    unknowns, cameras = random_unknowns(1), random_cameras(1)
    inverse = torch.linalg.inv(cameras)
    step = torch.zeros(1, COUNT, dtype=torch.float64)
    step[0, 3 * 7 + 1], step[0, 47], step[0, 48], step[0, 50], step[0, 60] = 0.2, 0.3, 5.0, 0.1, 2.0
    moved = unknowns.moved(step)
    assert_close(moved.joint_angles[0, 7, 1], unknowns.joint_angles[0, 7, 1] + 0.2)
    about_z = torch.from_numpy(rotation(2, 0.3))
    assert_close(moved.root_rotation[0], about_z @ unknowns.root_rotation[0])
    before, after = unknowns.translation(inverse), moved.translation(inverse)
    shifted = project(after[:, None], cameras) - project(before[:, None], cameras)
    assert_close(shifted[0, 0], torch.tensor([5.0, 0.0], dtype=torch.float64))
    assert_close(after[0, 2], before[0, 2] * torch.tensor(0.1, dtype=torch.float64).exp())
    assert_close(moved.shape[0, 9], unknowns.shape[0, 9] + 2.0)


def test_no_step_brings_a_hand_into_the_camera() -> None:
    unknowns = random_unknowns(1)
    step = torch.zeros(1, COUNT, dtype=torch.float64)
    step[:, 50] = -100.0
    depth = unknowns.moved(step).translation(torch.linalg.inv(random_cameras(1)))[:, 2]
    assert_close(depth, torch.full_like(depth, 0.05))


def test_starts_of_each_hand_are_behind_each_other() -> None:
    first, second = random_unknowns(2), random_unknowns(4)
    both = Unknowns.beside([first, second], 2)
    order = [0, 2, 3, 1, 4, 5]
    every = torch.cat([first.shape, second.shape])
    assert_close(both.shape, every[order])
