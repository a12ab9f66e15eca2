"""MANO's parameters in the files of other systems, as an audit reads them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.hand.anatomical_frame import joint_rotations
from hand_recon.hand.axis_angle import mirror_axis_angle, rotation_to_axis_angle
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.runs.audit.sources import Reading, read_given
from tests.support.audited_hands import natural_angles
from tests.support.mano_file import write_mano_folder

COUNT = 6


@pytest.fixture(scope="module")
def mano(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up file in MANO's format."""
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.mark.parametrize("form", ["hamer", "wilor-mini", "dyn-hamr", "smplx"])
def test_manos_rotations_in_the_forms_of_other_systems(
    mano: Path, tmp_path: Path, form: str
) -> None:
    """Matrices of right hands, axis angles that were mirrored back for left hands, and tracks of frames."""
    hand = mano_hand(mano)
    angles = natural_angles(COUNT)
    rotations = joint_rotations(angles, hand.frames, hand.rest_angles)
    axis_angles = rotation_to_axis_angle(rotations)
    is_right = np.array([1, 1, 1, 0, 0, 0])
    back = torch.where(
        torch.from_numpy(is_right == 0)[:, None, None], mirror_axis_angle(axis_angles), axis_angles
    )
    betas = torch.randn(COUNT, 10)
    eye = torch.eye(3).expand(COUNT, 1, 3, 3)
    forms: dict[str, dict[str, Any]] = {
        "hamer": {"hand_pose": rotations, "global_orient": eye, "betas": betas, "is_right": is_right},
        "wilor-mini": {
            "hand_pose": back, "global_orient": torch.zeros(COUNT, 1, 3), "betas": betas,
            "is_right": is_right,
        },
        "dyn-hamr": {
            "pose_body": axis_angles.reshape(2, 3, 15, 3), "root_orient": torch.zeros(2, 3, 3),
            "betas": betas[::3], "is_right": is_right.reshape(2, 3),
        },
        "smplx": {"poses": torch.cat([torch.zeros(COUNT, 3), axis_angles.flatten(1)], dim=1), "betas": betas},
    }  # fmt: skip
    arrays: dict[str, Any] = {key: np.asarray(value) for key, value in forms[form].items()}
    np.savez(tmp_path / "x.npz", **arrays)
    found = read_given([tmp_path / "x.npz"], hand, mano, Reading())
    assert found.exact.all()
    assert float((found.parameters.joint_angles - angles).abs().max()) < 1e-3
    assert set(found.hand_models) == {"mano"}
    if form != "smplx":
        assert found.left == (False,) * 3 + (True,) * 3
    assert bool(found.notes) == (form == "wilor-mini")
    assert found.parameters.shape.shape == (COUNT, 10)


def test_hawors_chunks_of_frames_are_sequences(mano: Path, tmp_path: Path) -> None:
    hand, angles = mano_hand(mano), natural_angles(COUNT)
    rotations = joint_rotations(angles, hand.frames, hand.rest_angles)
    chunk = {
        "init_root_orient": torch.eye(3).expand(1, COUNT, 3, 3).tolist(),
        "init_hand_pose": rotations[None].tolist(),
        "init_trans": torch.zeros(1, COUNT, 3).tolist(),
        "init_betas": torch.zeros(1, COUNT, 10).tolist(),
    }
    (tmp_path / "0_6.json").write_text(json.dumps(chunk))
    found = read_given([tmp_path], hand, mano, Reading())
    assert float((found.parameters.joint_angles - angles).abs().max()) < 1e-3
    assert len(set(found.sequences)) == 1
    assert found.times.tolist() == pytest.approx([frame / 30 for frame in range(COUNT)])


def test_tracks_of_both_hands_without_sides_are_told_apart(mano: Path, tmp_path: Path) -> None:
    """HaWoR's two tracks are a left hand's and a right hand's, with rotations of each."""
    hand, angles = mano_hand(mano), natural_angles(COUNT)
    right = rotation_to_axis_angle(joint_rotations(angles, hand.frames, hand.rest_angles))
    pose = torch.stack([mirror_axis_angle(right), right]).flatten(2)
    np.savez(tmp_path / "x.npz", hand_pose=pose.numpy(), betas=np.zeros((2, COUNT, 10)))
    found = read_given([tmp_path], hand, mano, Reading())
    assert float((found.parameters.joint_angles - angles.repeat(2, 1, 1)).abs().max()) < 1e-3
    assert len(found.notes) == 1
    assert "the rotations of track 0 are those of left hands" in found.notes[0]


@pytest.mark.parametrize("shape", [(3, 10), (0, 10), (2, 7), (4, 9)])
def test_shapes_of_other_numbers_of_hands_are_refused(
    mano: Path, tmp_path: Path, shape: tuple[int, int]
) -> None:
    np.savez(tmp_path / "x.npz", hand_pose=np.zeros((4, 15, 3)), betas=np.zeros(shape))
    with pytest.raises(ValueError, match=r"betas has the shape .* and hand_pose is of 4 hands"):
        read_given([tmp_path], mano_hand(mano), mano, Reading())


def test_one_shape_of_sixteen_numbers_is_that_of_all_frames(mano: Path, tmp_path: Path) -> None:
    betas = np.arange(16.0)
    np.savez(tmp_path / "x.npz", hand_pose=np.zeros((4, 15, 3)), betas=betas[None])
    found = read_given([tmp_path], mano_hand(mano), mano, Reading())
    assert found.parameters.shape.tolist() == [betas[:10].tolist()] * 4


def test_a_pose_without_numbers_is_refused(mano: Path, tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", hand_pose=np.float64(1.0), betas=np.zeros(10))
    with pytest.raises(ValueError, match=r"hand_pose has the shape \(\); expected rotations of 15"):
        read_given([tmp_path], mano_hand(mano), mano, Reading())


def test_coefficients_of_pose_components_are_refused(mano: Path, tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", hand_pose=np.zeros((4, 12)), betas=np.zeros((4, 10)))
    with pytest.raises(
        ValueError, match="A pose of 4 rotations was found; expected MANO's 15 joints"
    ):
        read_given([tmp_path], mano_hand(mano), mano, Reading())


def test_freihands_mano_labels_have_the_mean_pose_added(mano: Path, tmp_path: Path) -> None:
    hand, layer = mano_hand(mano), ManoLayer.load(mano)
    angles = natural_angles(2)
    pose = rotation_to_axis_angle(joint_rotations(angles, hand.frames, hand.rest_angles)).flatten(1)
    label = torch.cat([torch.zeros(2, 3), pose - layer.hands_mean, torch.zeros(2, 13)], dim=1)
    (tmp_path / "training_mano.json").write_text(json.dumps(label[:, None].tolist()))
    found = read_given([tmp_path], hand, mano, Reading())
    assert float((found.parameters.joint_angles - angles).abs().max()) < 1e-3
