"""FreiHAND's labels through MANO: the 61 stored parameters give the stored points."""

from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.freihand.datamodule import FreiHandDataModule
from hand_recon.data.freihand.dataset import FreiHand
from hand_recon.data.freihand.splits import FreiHandRecipe
from hand_recon.data.images import read_image
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.mano.labels import freihand_parameters
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout
from tests.support.freihand_folder import Folder, image_number, write_folder, write_json
from tests.support.mano_file import write_mano_folder

HANDS = 20


@pytest.fixture(scope="module")
def mano(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.fixture
def folder(tmp_path: Path, mano: Path) -> Folder:
    """A folder whose points are those of its MANO parameters."""
    folder = write_folder(tmp_path / "FreiHAND_pub_v2", hands=HANDS, versions=1)
    random = torch.Generator().manual_seed(0)
    label = torch.randn(HANDS, 61, generator=random) * 0.2
    # The middle MCP near the middle of an image of 64 pixels, at 0.6 to 0.8 m for f = 205.
    label[:, 58:60] += 32
    label[:, 60] = 205 / (0.6 + 0.2 * torch.rand(HANDS, generator=random))
    layer = ManoLayer.load(mano, landmark_set="mano")
    intrinsics = torch.from_numpy(folder.intrinsics).float()
    with torch.no_grad():
        posed = layer(*freihand_parameters(layer, label, intrinsics))
    landmarks = posed.landmarks.double().numpy()
    write_json(folder.root / "training_mano.json", label[:, None].double().numpy())
    write_json(folder.root / "training_xyz.json", landmarks)
    write_json(folder.root / "training_verts.json", posed.vertices.double().numpy())
    phalanx = np.linalg.norm(landmarks[:, 9] - landmarks[:, 10], axis=-1)
    write_json(folder.root / "training_scale.json", phalanx)
    return Folder(folder.root, landmarks, folder.intrinsics)


def test_the_training_hands_parameters_are_their_points(folder: Folder, mano: Path) -> None:
    data = FreiHandDataModule(folder.root, mano=mano, crop=CropPolicy(64))
    parameters = data.train_parameters()
    assert parameters is not None
    with torch.no_grad():
        placed = mano_hand(mano).to_camera(parameters)
    training = FreiHand("train", data.recipe)
    hands = [image_number(training[index].source) for index in range(len(training))]
    assert len(placed.landmarks) == len(hands) == 16
    np.testing.assert_allclose(placed.landmarks, folder.landmarks[hands], atol=2e-6)


def test_a_limit_spreads_over_the_set_and_no_mano_gives_none(folder: Folder, mano: Path) -> None:
    data = FreiHandDataModule(folder.root, mano=mano, crop=CropPolicy(64))
    everything, some = data.train_parameters(), data.train_parameters(4)
    assert everything is not None
    assert some is not None
    torch.testing.assert_close(some.joint_angles, everything.joint_angles[::4])
    assert FreiHandDataModule(folder.root, crop=CropPolicy(64)).train_parameters() is None
    (folder.root / "training_mano.json").unlink()
    assert data.train_parameters() is None


def test_surfaces_are_scored_with_mano_and_left_out_without(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    crop = CropPolicy(64)
    assert (
        FreiHand("test", FreiHandRecipe(folder.root, crop, topology="mano"))[0].vertices is not None
    )
    assert FreiHand("test", FreiHandRecipe(folder.root, crop))[0].vertices is None
    assert "hand=mano has them" in caplog.text


def test_a_folder_written_with_mano_has_the_parameters_of_its_points_and_images(
    mano: Path, tmp_path: Path
) -> None:
    root = tmp_path / "FreiHAND_pub_v2"
    layer = ManoLayer.load(mano, landmark_set="mano")
    write_freihand_layout(root, FreiHandFolder(unique=8, evaluation=2, mano=layer))
    data = FreiHandDataModule(root, mano=mano, crop=CropPolicy(224), topology="mano")
    parameters = data.train_parameters()
    assert parameters is not None
    training = data.dataset_with_surfaces("train")
    with torch.no_grad():
        placed = mano_hand(mano).to_camera(parameters)
    first_versions = [training[index] for index in range(len(parameters.shape))]
    for made, landmarks, sample in zip(
        placed.vertices, placed.landmarks, first_versions, strict=True
    ):
        assert sample.vertices is not None
        assert sample.landmarks_3d is not None
        torch.testing.assert_close(made, sample.vertices, atol=2e-6, rtol=0)
        torch.testing.assert_close(landmarks, sample.landmarks_3d, atol=2e-6, rtol=0)
        # All of the hand is in the image, where the mask has it.
        assert ((sample.landmarks_2d > 0) & (sample.landmarks_2d < 224)).all()
        mask = read_image(root / "training" / "mask" / f"{image_number(sample.source):08d}.jpg")
        assert mask is not None
        u, v = sample.landmarks_2d.numpy().astype(int).T
        assert (mask[v, u, 0] > 150).mean() > 0.8
    # Gestures are natural: no finger is bent further than a hinge joint allows.
    bends = parameters.joint_angles[:, [4, 5, 7, 8, 10, 11, 13, 14], 0]
    assert bends.min() > -0.2
    assert bends.max() < 2.3


def test_surfaces_are_shown_for_every_split_on_demand_alone(folder: Folder) -> None:
    data = FreiHandDataModule(folder.root, crop=CropPolicy(64), topology="mano")
    for split in ("train", "val"):
        assert data.dataset(split)[0].vertices is None
        assert data.dataset_with_surfaces(split)[0].vertices is not None
