"""HO3D's MANO parameters give its surfaces and, for learnt priors, its poses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.dataset import load_batch
from hand_recon.data.ho3d.datamodule import Ho3dDataModule
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.mano.layer import ManoLayer
from tests.support.ho3d_folder import Folder, edit_meta, write_folder
from tests.support.mano_file import write_mano_folder

CROP = CropPolicy(size=32, around="joints")


@pytest.fixture(scope="module")
def mano(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.fixture
def folder(tmp_path: Path, mano: Path) -> Folder:
    return write_folder(tmp_path / "HO3D_v3", layer=ManoLayer.load(mano, "right", "ho3d"))


def recipe(folder: Folder, **fields: Any) -> Ho3dRecipe:  # noqa: ANN401  # any field
    return replace(Ho3dRecipe(folder.root, crop=CROP, topology="mano"), **fields)


def test_training_surfaces_are_made_from_manos_numbers(folder: Folder, mano: Path) -> None:
    data = Ho3d("val", recipe(folder, mano=mano), with_vertices=True)
    for index, frame in enumerate(data.frames):
        made = data[index].vertices
        assert made is not None
        np.testing.assert_allclose(made, folder.train[frame].vertices, atol=2e-6)


def test_parameters_pose_the_hand_that_the_labels_show(folder: Folder, mano: Path) -> None:
    module = Ho3dDataModule(folder.root, crop=CROP, mano=mano, topology="mano")
    parameters = module.train_parameters()
    data = module.dataset("train")
    assert parameters is not None
    placed = mano_hand(mano, "ho3d").to_camera(parameters)
    ground_truth = load_batch(data, list(range(len(data)))).landmarks_3d
    assert ground_truth is not None
    torch.testing.assert_close(placed.landmarks, ground_truth, atol=1e-5, rtol=0)
    fewer = module.train_parameters(3)
    assert fewer is not None
    assert fewer.shape.shape == (3, 10)


def test_a_look_at_the_training_hands_shows_their_surfaces(folder: Folder, mano: Path) -> None:
    module = Ho3dDataModule(folder.root, crop=CROP, mano=mano, topology="mano")
    assert module.dataset("train")[0].vertices is None
    assert module.dataset_with_surfaces("train")[0].vertices is not None


def test_without_mano_there_are_no_parameters(
    folder: Folder, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert Ho3dDataModule(folder.root, crop=CROP).train_parameters() is None
    assert Ho3dDataModule(folder.root, crop=CROP, mano=tmp_path).train_parameters() is None
    assert "Without MANO, HO3D's training hands have no surfaces" in caplog.text
    data = Ho3d("val", recipe(folder), with_vertices=True)
    assert data[0].vertices is None


def test_frames_without_manos_numbers_have_landmarks_alone(folder: Folder, mano: Path) -> None:
    def forget(meta: dict[str, Any]) -> None:
        meta["handBeta"] = None

    for frame in folder.train:
        edit_meta(folder.meta(frame), forget)
    data = Ho3d("val", recipe(folder, mano=mano), with_vertices=True)
    assert data[0].vertices is None
    assert data[0].landmarks_3d is not None
    assert Ho3dDataModule(folder.root, crop=CROP, mano=mano).train_parameters() is None


def test_numbers_that_are_not_those_of_the_landmarks_are_refused(
    folder: Folder, mano: Path
) -> None:
    def mean_pose(meta: dict[str, Any]) -> None:
        """The pose in FreiHAND's convention, relative to a mean."""
        meta["handPose"] = meta["handPose"] + 0.2 * np.r_[np.zeros(3), np.ones(45)]

    for frame in folder.train:
        edit_meta(folder.meta(frame), mean_pose)
    with pytest.raises(ValueError, match=r"MANO's hands miss handJoints3D by .*flat mean"):
        Ho3d("val", recipe(folder, mano=mano), with_vertices=True)


def test_surfaces_of_mano_are_for_the_mano_hand(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    data = Ho3d("test", recipe(folder, topology="open"))
    assert data[0].vertices is None
    assert "MANO's surfaces, which cannot be compared" in caplog.text
    assert Ho3d("test", recipe(folder))[0].vertices is not None
