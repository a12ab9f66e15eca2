"""MANO's layer against a slow reference, and the label conventions of each dataset."""

from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.camera import project
from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.axis_angle import axis_angle_to_rotation, mirror_axis_angle
from hand_recon.hand.mano.conversion import prepare_mano
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.mano.labels import (
    dexycb_parameters,
    freihand_parameters,
    freihand_root,
    from_opengl,
    ho3d_parameters,
)
from hand_recon.hand.mano.layer import ManoLayer, ManoParameters
from hand_recon.hand.mano.store import Side, read_mano
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARKS
from tests.support.mano_file import mano_arrays, mano_pickle, write_mano_folder
from tests.support.mano_reference import posed_by_definition
from tests.support.tolerance import BATCH_SHAPES, assert_close

MIRROR = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
FLIP = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.fixture(scope="module")
def layer(folder: Path) -> ManoLayer:
    return load(folder)


def load(
    folder: Path, side: Side = "right", landmark_set: str = "mano", fixed: bool = True
) -> ManoLayer:
    return ManoLayer.load(folder, side, landmark_set, fixed, dtype=torch.float64)


def random_hand(*batch: int) -> ManoParameters:
    return ManoParameters(
        torch.randn(*batch, 3, dtype=torch.float64),
        0.4 * torch.randn(*batch, 45, dtype=torch.float64),
        torch.randn(*batch, 10, dtype=torch.float64),
        torch.randn(*batch, 3, dtype=torch.float64),
    )


@pytest.mark.parametrize("side", ["right", "left"])
def test_agrees_with_mano_written_out_entry_by_entry(folder: Path, side: Side) -> None:
    """Checks the order of the pose blend shapes too; the left hand has its released shape directions."""
    hand = random_hand()
    vertices, joints = posed_by_definition(mano_arrays(side), *(part.numpy() for part in hand))
    posed = load(folder, side, fixed=False)(*hand)
    assert_close(posed.vertices, torch.from_numpy(vertices))
    assert_close(posed.joints, torch.from_numpy(joints))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_each_hand_of_a_batch_is_posed_alone(layer: ManoLayer, shape: tuple[int, ...]) -> None:
    hands = random_hand(*shape)
    together = layer(*hands).landmarks
    assert together.shape == (*shape, 21, 3)
    flat = [part.reshape(-1, part.shape[-1]) for part in hands]
    alone = torch.stack([layer(*one).landmarks for one in zip(*flat, strict=True)])
    assert_close(together.reshape(-1, 21, 3), alone)


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_hand_parameters_give_the_same_hand_at_the_same_position(
    folder: Path, layer: ManoLayer, shape: tuple[int, ...]
) -> None:
    hand = random_hand(*shape)
    own, theirs = layer.hand.to_camera(layer.hand_parameters(*hand)), layer(*hand)
    assert_close(own.vertices, theirs.vertices)
    assert_close(own.joints, theirs.joints)
    assert_close(own.landmarks, theirs.landmarks)


def test_in_single_precision_the_two_agree_to_a_micrometre(folder: Path) -> None:
    layer = ManoLayer.load(folder)
    hand = ManoParameters(*(0.5 * part.float() for part in random_hand(8)))
    posed = mano_hand(folder).to_camera(layer.hand_parameters(*hand))
    assert (posed.vertices - layer(*hand).vertices).abs().max() < 1e-6


def test_hand_parameters_of_a_left_hand_are_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"MANO's left hand\. Mirror the axis angles"):
        load(folder, "left").hand_parameters(*random_hand())


def test_the_global_rotation_is_about_the_wrist_which_is_not_the_origin(layer: ManoLayer) -> None:
    hand = random_hand(4)
    wrist = layer.wrist(hand.shape)
    assert_close(layer(*hand).joints[:, 0], wrist + hand.translation)
    assert wrist.norm(dim=-1).min() > 0.05


# Conventions of the datasets that are easy to get wrong.


def test_pca_coefficients_are_directions_about_the_mean_even_when_there_are_45(
    layer: ManoLayer,
) -> None:
    """Computed by hand: 0.5 times the second component minus the last one."""
    coefficients = torch.zeros(45, dtype=torch.float64)
    coefficients[1], coefficients[44] = 0.5, -1.0
    arrays = mano_arrays()
    rows = arrays["hands_components"]
    expected = arrays["hands_mean"] + 0.5 * rows[1] - rows[44]
    assert_close(layer.from_pca(coefficients), torch.from_numpy(expected))


def test_dexycb_reads_coefficients_freihand_residuals_and_ho3d_angles(layer: ManoLayer) -> None:
    """Zeros are the mean pose in FreiHAND and DexYCB, and the flat rest pose in HO3D."""
    mean, zeros = torch.from_numpy(mano_arrays()["hands_mean"]), torch.zeros(61).double()
    camera = torch.tensor([[400.0, 0, 100], [0, 400, 110], [0, 0, 1]], dtype=torch.float64)
    freihand = freihand_parameters(layer, zeros + torch.eye(61)[60].double(), camera)
    assert_close(freihand.pose, mean)
    assert_close(dexycb_parameters(layer, zeros[:51], zeros[:10]).pose, mean)
    assert_close(ho3d_parameters(layer, zeros[:48], zeros[:10], zeros[:3]).pose, zeros[:45])


def test_a_dexycb_label_is_rotation_coefficients_and_translation_in_this_order(
    folder: Path,
) -> None:
    layer = load(folder, "left", "dexycb", fixed=False)
    label = 0.3 * torch.randn(51, dtype=torch.float64)
    shape = torch.randn(10, dtype=torch.float64)
    parameters = dexycb_parameters(layer, label, shape)
    arrays = mano_arrays("left")
    pose = arrays["hands_mean"] + label[3:48].numpy() @ arrays["hands_components"]
    vertices, joints = posed_by_definition(
        arrays, label[:3].numpy(), pose, shape.numpy(), label[48:].numpy()
    )
    posed = layer(*parameters)
    assert_close(posed.vertices, torch.from_numpy(vertices))
    assert_close(posed.landmarks[0], torch.from_numpy(joints[0]))
    assert_close(posed.landmarks[LANDMARKS.index("middle tip")], torch.from_numpy(vertices[445]))


def test_one_shape_is_one_hand_on_both_sides_only_once_the_left_directions_are_corrected(
    folder: Path,
) -> None:
    """With mirrored axis angles the corrected left hand is the exact mirror image."""
    hand = random_hand(3)
    mirrored = ManoParameters(
        mirror_axis_angle(hand.global_rotation),
        mirror_axis_angle(hand.pose.unflatten(-1, (15, 3))).flatten(-2),
        hand.shape,
        hand.translation * MIRROR,
    )
    expected = load(folder)(*hand).vertices * MIRROR
    assert_close(load(folder, "left", fixed=True)(*mirrored).vertices, expected)
    unfixed = load(folder, "left", fixed=False)(*mirrored).vertices
    assert (unfixed - expected).norm(dim=-1).mean() > 1e-3


def test_a_left_hand_that_is_corrected_already_is_not_corrected_twice(tmp_path: Path) -> None:
    """The right hand decides, in either order of conversion; released directions can be restored."""
    arrays = mano_arrays("left")
    released = arrays["shapedirs"].copy()
    arrays["shapedirs"][:, 0] *= -1
    (tmp_path / "left.pkl").write_bytes(mano_pickle(arrays))
    (tmp_path / "right.pkl").write_bytes(mano_pickle(mano_arrays("right")))
    for name in ("left", "right"):
        prepare_mano(tmp_path / f"{name}.pkl", tmp_path)
    assert read_mano(tmp_path, "left").left_shape == "unknown"
    mended, as_released = (load(tmp_path, "left", fixed=fixed) for fixed in (True, False))
    assert_close(mended.hand.shape_directions, torch.from_numpy(arrays["shapedirs"]))
    assert_close(as_released.hand.shape_directions, torch.from_numpy(released))


def test_coefficients_of_one_side_mean_another_pose_on_the_other(folder: Path) -> None:
    """The two hands have different components, so changing signs does not mirror coefficients."""
    coefficients = torch.randn(45, dtype=torch.float64)
    right, left = (load(folder, side).from_pca(coefficients) for side in ("right", "left"))
    assert (mirror_axis_angle(right.unflatten(-1, (15, 3))).flatten() - left).abs().max() > 0.1


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_freihands_translation_puts_the_middle_mcp_on_its_pixel_at_its_scale(
    layer: ManoLayer, shape: tuple[int, ...]
) -> None:
    label = 0.4 * torch.randn(*shape, 61, dtype=torch.float64)
    label[..., 58:60] = torch.tensor([80.0, 120.0], dtype=torch.float64)
    label[..., 60] = 700.0
    camera = torch.tensor([[480.0, 0, 112], [0, 520, 100], [0, 0, 1]], dtype=torch.float64)
    intrinsics = camera.expand(*shape, 3, 3)
    parameters = freihand_parameters(layer, label, intrinsics)
    landmarks = layer(*parameters).landmarks
    # Computed by hand: f = 500; (80 − 112, 120 − 100, 500) / 700.
    expected = torch.tensor([-32 / 700, 20 / 700, 500 / 700], dtype=torch.float64)
    assert_close(landmarks[..., 9, :], expected.expand(*shape, 3))
    square = camera.clone()
    square[0, 0] = square[1, 1] = 500.0
    pixels = project(landmarks, square.expand(*shape, 3, 3))
    assert_close(pixels[..., 9, :], label[..., 58:60])
    assert_close(parameters.pose, layer.from_residual(label[..., 3:48]))


def test_freihands_label_of_a_known_hand_recovers_it(layer: ManoLayer) -> None:
    hand = random_hand(5)
    hand = hand._replace(translation=hand.translation * 0.05 + torch.tensor([0.0, 0, 0.7]))
    camera = torch.tensor([[500.0, 0, 112], [0, 500, 112], [0, 0, 1]], dtype=torch.float64)
    root = layer(*hand).landmarks[:, 9]
    label = torch.cat(
        [
            hand.global_rotation,
            hand.pose - layer.hands_mean,
            hand.shape,
            project(root[:, None], camera.expand(5, 3, 3))[:, 0],
            500.0 / root[:, 2:],
        ],
        dim=1,
    )
    back = freihand_parameters(layer, label, camera.expand(5, 3, 3))
    for found, expected in zip(back, hand, strict=True):
        assert_close(found, expected)


def test_freihands_root_uses_the_mean_of_both_focal_lengths() -> None:
    camera = torch.tensor([[400.0, 0, 10], [0, 600, 20], [0, 0, 1]])
    root = freihand_root(torch.tensor([30.0, 10.0]), torch.tensor(1000.0), camera)
    torch.testing.assert_close(root, torch.tensor([0.02, -0.01, 0.5]))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_ho3ds_hand_is_in_this_projects_camera_axes(folder: Path, shape: tuple[int, ...]) -> None:
    """y and z change sign for vertices, joints and landmarks."""
    layer = load(folder, "right", "ho3d")
    hand = random_hand(*shape)
    stored = layer(*hand)
    label = torch.cat([hand.global_rotation, hand.pose], dim=-1)
    flipped = layer(*ho3d_parameters(layer, label, hand.shape, hand.translation))
    assert_close(flipped.vertices, stored.vertices * FLIP)
    assert_close(flipped.joints, stored.joints * FLIP)
    assert_close(flipped.landmarks, stored.landmarks * FLIP)


def test_converting_opengls_axes_twice_is_the_identity(layer: ManoLayer) -> None:
    hand = random_hand(6)
    wrist = layer.wrist(hand.shape)
    once = from_opengl(hand.global_rotation, hand.translation, wrist)
    rotation, translation = from_opengl(*once, wrist)
    assert_close(axis_angle_to_rotation(rotation), axis_angle_to_rotation(hand.global_rotation))
    assert_close(translation, hand.translation)


def test_flipping_the_translation_alone_would_be_centimetres_off(layer: ManoLayer) -> None:
    """F t instead of F (J0 + t) − J0 would ignore the wrist's offset from the origin."""
    hand = random_hand()
    right = from_opengl(hand.global_rotation, hand.translation, layer.wrist(hand.shape))[1]
    assert (FLIP * hand.translation - right).norm() > 0.01


def test_a_hand_posed_by_rotations_is_the_hand_posed_by_its_angles(hand: HandModel) -> None:
    """`HandModel.pose` is `forward` without joint angles."""
    angles, shape = 0.5 * torch.randn(4, 15, 3), torch.randn(4, 10)
    rotations = joint_rotations(angles, hand.frames, hand.rest_angles)
    assert torch.equal(hand.pose(rotations, shape).vertices, hand(angles, shape).vertices)


def test_gradients_reach_every_parameter(layer: ManoLayer) -> None:
    hand = [part.requires_grad_() for part in random_hand(2)]
    assert torch.autograd.gradcheck(lambda *parts: layer(*parts).landmarks, hand, fast_mode=True)


def test_the_slow_reference_does_not_share_code_with_the_layer() -> None:
    """Computed by hand: 90° about z at the index DIP moves a point 1 cm beyond it to −y."""
    arrays = mano_arrays()
    arrays["posedirs"] *= 0
    arrays["weights"] = np.zeros((778, 16))
    arrays["weights"][:, 3] = 1.0
    joint = arrays["J_regressor"][3] @ arrays["v_template"]
    pose = np.zeros(45)
    pose[8] = np.pi / 2
    vertices, joints = posed_by_definition(arrays, np.zeros(3), pose, np.zeros(10), np.zeros(3))
    away = arrays["v_template"] - joint
    np.testing.assert_allclose(joints[3], joint, atol=1e-12)
    np.testing.assert_allclose(
        vertices - joint, np.stack([-away[:, 1], away[:, 0], away[:, 2]], axis=1), atol=1e-12
    )
