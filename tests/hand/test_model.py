"""The hand model against a slow reference, and its invariances."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from hand_recon.camera import six_d_to_rotation
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import load_open_hand
from hand_recon.hand.skeleton import JOINTS, LANDMARKS, PARENTS, ROOT_JOINT
from hand_recon.schema import HandParameters
from tests.support.tolerance import BATCH_SHAPES, assert_close


def pose(shape: tuple[int, ...], scale: float = 0.4) -> tuple[torch.Tensor, torch.Tensor]:
    """Random joint angles and shapes in double precision."""
    return (
        scale * torch.randn(*shape, 15, 3, dtype=torch.float64),
        torch.randn(*shape, 10, dtype=torch.float64),
    )


def skin_by_hand(hand: HandModel, angles: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Linear blend skinning with 4×4 matrices, one joint and one vertex at a time."""
    vertices = hand.template.numpy() + hand.shape_directions.numpy() @ shape
    joints = hand.joints_template.numpy() + hand.joint_shape_directions.numpy() @ shape
    vertices, joints = vertices - joints[ROOT_JOINT], joints - joints[ROOT_JOINT]
    world = [np.eye(4)]
    for joint in range(1, 16):
        local = np.eye(4)
        frame = hand.frames[joint - 1].numpy()
        rest = euler(hand.rest_angles[joint - 1].numpy())
        local[:3, :3] = frame @ rest.T @ euler(angles[joint - 1]) @ frame.T
        towards, back = np.eye(4), np.eye(4)
        towards[:3, 3], back[:3, 3] = joints[joint], -joints[joint]
        world.append(world[PARENTS[joint]] @ towards @ local @ back)
    posed = []
    for vertex, weights in zip(vertices, hand.skinning_weights.numpy(), strict=True):
        blend = sum(weight * matrix for weight, matrix in zip(weights, world, strict=True))
        posed.append((blend @ np.append(vertex, 1.0))[:3])
    return np.array(posed)


def euler(angles: np.ndarray) -> np.ndarray:
    """Ry(splay) Rx(twist) Rz(bend), factor by factor."""
    bend, splay, twist = angles

    def about(axis: int, angle: float) -> np.ndarray:
        matrix = np.eye(3)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        matrix[first, first] = matrix[second, second] = np.cos(angle)
        matrix[second, first], matrix[first, second] = np.sin(angle), -np.sin(angle)
        return matrix

    return about(1, splay) @ about(0, twist) @ about(2, bend)


@pytest.fixture(scope="module")
def hand64(hand: HandModel) -> HandModel:
    """The open hand in double precision, with frames and weights made exact."""
    return polished(copy.deepcopy(hand).double())


def polished(hand: HandModel) -> HandModel:
    """Copy with exactly orthonormal frames and weights that sum exactly to one."""
    left, _, right = torch.linalg.svd(hand.frames)
    weights = hand.skinning_weights / hand.skinning_weights.sum(dim=1, keepdim=True)
    return hand.with_arrays(frames=left @ right, skinning_weights=weights)


def test_an_array_of_the_surface_is_replaced_in_a_copy_only(hand64: HandModel) -> None:
    angles, shape = pose(())
    before = hand64(angles, shape).vertices
    with pytest.raises(AttributeError, match=r"with_arrays\(template=\.\.\.\)"):
        hand64.template = 2 * hand64.template
    doubled = hand64.with_arrays(template=2 * hand64.template)
    flat = torch.zeros_like(shape)
    assert (doubled(angles, flat).vertices - hand64(angles, flat).vertices).norm() > 0.1
    assert_close(hand64(angles, shape).vertices, before)


def test_agrees_with_skinning_written_out_vertex_by_vertex(hand64: HandModel) -> None:
    angles, shape = pose(())
    expected = skin_by_hand(hand64, angles.numpy(), shape.numpy())
    assert_close(hand64(angles, shape).vertices, torch.from_numpy(expected))


def test_pose_directions_add_to_the_surface_before_skinning(hand64: HandModel) -> None:
    asset = load_open_hand()
    directions = torch.randn(
        len(asset.template), 3, 135, generator=torch.Generator().manual_seed(1)
    )
    blended = polished(HandModel(replace(asset, pose_directions=directions * 1e-3)).double())
    at_rest = blended(blended.rest_angles, torch.zeros(10, dtype=torch.float64))
    assert_close(at_rest.vertices, hand64.rest(torch.zeros(10, dtype=torch.float64))[0])
    angles, shape = pose(())
    assert (blended(angles, shape).vertices - hand64(angles, shape).vertices).norm() > 1e-3


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_each_hand_of_a_batch_is_posed_alone(hand64: HandModel, shape: tuple[int, ...]) -> None:
    angles, betas = pose(shape)
    together = hand64(angles, betas)
    assert together.vertices.shape == (*shape, len(hand64.template), 3)
    flat = zip(angles.reshape(-1, 15, 3), betas.reshape(-1, 10), strict=True)
    alone = torch.stack([hand64(one, beta).landmarks for one, beta in flat])
    assert_close(together.landmarks.reshape(-1, 21, 3), alone)


def test_single_precision_is_exact_to_a_micrometre(hand: HandModel, hand64: HandModel) -> None:
    angles, shape = pose((16,))
    difference = hand(angles.float(), shape.float()).vertices - hand64(angles, shape).vertices
    assert difference.abs().max() < 1e-6


def test_the_rest_angles_give_the_rest_pose(hand64: HandModel) -> None:
    shape = torch.randn(10, dtype=torch.float64)
    vertices, joints = hand64.rest(shape)
    posed = hand64(hand64.rest_angles, shape)
    assert_close(posed.vertices, vertices)
    assert_close(posed.joints, joints)


def test_the_middle_mcp_stays_at_the_origin(hand64: HandModel) -> None:
    joints = hand64(*pose((5,))).joints
    assert_close(joints[:, ROOT_JOINT], torch.zeros(5, 3, dtype=torch.float64))


def test_bones_keep_their_length(hand64: HandModel) -> None:
    angles, shape = pose((6,), scale=1.5)
    rest, posed = hand64.rest(shape)[1], hand64(angles, shape).joints
    parents = list(PARENTS[1:])
    assert_close(
        (posed[:, 1:] - posed[:, parents]).norm(dim=-1),
        (rest[:, 1:] - rest[:, parents]).norm(dim=-1),
    )


def test_a_finger_moves_no_other_finger(hand64: HandModel) -> None:
    angles = torch.zeros(15, 3, dtype=torch.float64)
    bent = angles.clone()
    bent[JOINTS.index("ring MCP") - 1, 0] = 1.0
    zero = torch.zeros(10, dtype=torch.float64)
    moved = (hand64(bent, zero).landmarks - hand64(angles, zero).landmarks).norm(dim=-1)
    others = [i for i, name in enumerate(LANDMARKS) if not name.startswith("ring")]
    assert moved[others].max() < 2e-3
    assert moved[LANDMARKS.index("ring tip")] > 0.05


def test_to_camera_rotates_about_the_middle_mcp_and_then_translates(hand64: HandModel) -> None:
    angles, shape = pose((3,))
    rotation = six_d_to_rotation(torch.randn(3, 6, dtype=torch.float64))
    translation = torch.randn(3, 3, dtype=torch.float64)
    posed = hand64.to_camera(HandParameters(angles, shape, rotation, translation))
    assert_close(posed.joints[:, ROOT_JOINT], translation)
    own = hand64(angles, shape)
    assert_close(
        posed.vertices, torch.einsum("bxy,bvy->bvx", rotation, own.vertices) + translation[:, None]
    )


def test_gradients_match_finite_differences(hand64: HandModel) -> None:
    angles, shape = pose((2,))
    picked = torch.linspace(0, len(hand64.template) - 1, 9).long()

    def some_points(angles: torch.Tensor, shape: torch.Tensor) -> torch.Tensor:
        posed = hand64(angles, shape)
        return torch.cat([posed.vertices[:, picked], posed.landmarks], dim=1)

    assert torch.autograd.gradcheck(
        some_points, (angles.requires_grad_(), shape.requires_grad_()), fast_mode=True
    )


def test_an_unknown_landmark_set_is_refused_with_the_known_ones() -> None:
    cure = r"landmark_set=<set> in fit and predict, data\.landmark_set=<set> in training"
    with pytest.raises(ValueError, match=rf"no landmark set 'coco'.*knuckle.*mano.*: {cure}"):
        HandModel(load_open_hand(), "coco")


def test_a_mirrored_hand_poses_as_the_mirror_image(hand64: HandModel) -> None:
    """Mirrored frames keep the sign of bend; splay and twist change theirs."""
    asset = load_open_hand()
    mirror = torch.diag(torch.tensor([1.0, 1.0, -1.0]))
    # A mirrored frame is left-handed; reversing its twist and splay axes makes it right-handed again.
    # Bend then keeps its sign, and the angles about the reversed axes change theirs.
    flip = torch.diag(torch.tensor([1.0, 1.0, -1.0]))
    left = HandModel(
        replace(
            asset,
            template=asset.template @ mirror,
            joints=asset.joints @ mirror,
            shape_directions=mirror @ asset.shape_directions,
            joint_shape_directions=mirror @ asset.joint_shape_directions,
            frames=mirror @ asset.frames @ flip,
            rest_angles=asset.rest_angles * torch.tensor([1.0, -1.0, -1.0]),
        )
    ).double()
    left = polished(left)
    angles, shape = pose((4,))
    signs = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)
    mirrored = left(angles * signs, shape).vertices
    assert_close(mirrored, hand64(angles, shape).vertices @ mirror.double())


@pytest.mark.parametrize("landmark_set", ["knuckle", "mano"])
@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_the_hand_of_its_landmarks_has_them_and_their_gradients(
    landmark_set: str, shape: tuple[int, ...]
) -> None:
    """About a tenth of the vertices give the same landmarks up to rounding."""
    whole = HandModel(load_open_hand(), landmark_set).double()
    light = whole.landmarks_only()
    results = []
    for hand in (whole, light):
        leaves = [value.requires_grad_() for value in map(torch.clone, seeded_pose(shape))]
        posed = hand(leaves[0], leaves[1])
        posed.landmarks.square().sum().backward()
        results.append(
            (posed.landmarks.detach(), posed.joints.detach(), leaves[0].grad, leaves[1].grad)
        )
    for full, few in zip(*results, strict=True):
        assert full is not None
        assert few is not None
        assert_close(few, full)


def seeded_pose(shape: tuple[int, ...]) -> tuple[torch.Tensor, torch.Tensor]:
    torch.manual_seed(3)
    return pose(shape)


def test_the_hand_of_its_landmarks_is_light_and_leaves_the_whole_one_alone(
    hand64: HandModel,
) -> None:
    before = {name: buffer.clone() for name, buffer in hand64.named_buffers()}
    light = hand64.landmarks_only()
    assert 10 < len(light.template) < len(hand64.template) / 5
    assert light.faces.shape == (0, 3)
    assert light.wrist_ring.shape == (0,)
    assert (light.landmark_set, light.name) == (hand64.landmark_set, hand64.name)
    light.template.zero_()
    for name, buffer in hand64.named_buffers():
        assert torch.equal(buffer, before[name]), name


def test_the_hand_of_its_landmarks_keeps_pose_directions() -> None:
    asset = load_open_hand()
    directions = 1e-3 * torch.randn(len(asset.template), 3, 135)
    whole = HandModel(replace(asset, pose_directions=directions)).double()
    light = whole.landmarks_only()
    assert light.pose_directions is not None
    assert len(light.pose_directions) == len(light.template)
    angles, shape = pose((4,))
    assert_close(light(angles, shape).landmarks, whole(angles, shape).landmarks)


def test_a_hand_of_one_shape_is_the_model_with_this_shape_whatever_its_coefficients(
    hand64: HandModel,
) -> None:
    shape = torch.randn(10, dtype=torch.float64)
    pose = 0.3 * torch.randn(3, 15, 3, dtype=torch.float64)
    found = hand64.of_shape(shape)(pose, torch.randn(3, 10, dtype=torch.float64))
    expected = hand64(pose, shape.expand(3, 10))
    for name in ("vertices", "joints", "landmarks"):
        assert_close(getattr(found, name), getattr(expected, name))
    # The model itself is not changed.
    assert not torch.allclose(found.joints[0], hand64(pose[0], 0 * shape).joints)
    fixed = hand64.of_shape(shape)
    assert (fixed.name, fixed.one_shape, hand64.one_shape) == ("open", True, False)
    assert fixed.landmarks_only().one_shape
