"""DexYCB's surfaces through MANO, against MANO written out, in both conventions for left hands."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from hand_recon.data.crop import CropPolicy
from hand_recon.data.dexycb.datamodule import DexYcbDataModule
from hand_recon.data.dexycb.dataset import DexYcb, DexYcbRecipe
from hand_recon.data.dexycb.surfaces import DexYcbSurfaces, ManoPair, load_pair
from hand_recon.hand.mano.layer import ManoLayer
from hand_recon.rehearsal.dexycb import DexYcbFolder, write_dexycb_layout
from tests.support.dexycb_folder import label_of, meta_of
from tests.support.mano_file import mano_arrays, write_mano_folder
from tests.support.mano_reference import posed_by_definition

MIRROR = np.array([-1.0, 1.0, 1.0])

TIPS = {"right": [745, 317, 444, 556, 673], "left": [745, 317, 445, 556, 673]}
"""Manopth's fingertips, thumb first."""


@pytest.fixture(scope="module")
def mano(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mano_folder(tmp_path_factory.mktemp("mano"))


@pytest.fixture(scope="module")
def root(mano: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("dexycb") / "dex-ycb"
    pair = load_pair(mano, left_hands=True)
    write_dexycb_layout(root, DexYcbFolder(subjects=(0, 2), every=19, mano=pair))
    return root


def recipe(root: Path, mano: Path | None, **changes: object) -> DexYcbRecipe:
    fields: dict[str, object] = {
        "setup": "s2", "partial": True, "crop": CropPolicy(32, "joints"), "label_workers": 0,
        "mano": mano, "topology": "mano",
    }  # fmt: skip
    return DexYcbRecipe(root, **(fields | changes))  # type: ignore[arg-type]  # of the right types


def surfaces_of(data: DexYcb) -> DexYcbSurfaces:
    found = data.surfaces()
    assert found is not None
    return found


def test_surfaces_are_mano_posed_by_the_label_with_the_betas_of_its_calibration(
    root: Path, mano: Path
) -> None:
    """Pose = mean + coefficients × components of the hand's own side; left shapes as released."""
    data = DexYcb("test", recipe(root, mano))
    surfaces = surfaces_of(data)
    seen = set()
    for row in range(len(data)):
        source = data.hands.source(row)
        meta, label = meta_of(root, source), label_of(root, source)
        side, calibration = meta["mano_sides"][0], meta["mano_calib"][0]
        if (side, source[:8]) in seen:
            continue
        seen.add((side, source[:8]))
        betas = yaml.safe_load(
            (root / "calibration" / f"mano_{calibration}" / "mano.yml").read_text()
        )
        arrays, pose_m = mano_arrays(side), label["pose_m"][0].astype(float)
        pose = arrays["hands_mean"] + pose_m[3:48] @ arrays["hands_components"]
        vertices, joints = posed_by_definition(
            arrays, pose_m[:3], pose, np.array(betas["betas"]), pose_m[48:]
        )
        np.testing.assert_allclose(surfaces(row), vertices, atol=2e-6)
        # The labels: rotation centres in FreiHAND's order, and manopth's tips on the surface.
        points = label["joint_3d"][0]
        by_joint = points[[0, 5, 6, 7, 9, 10, 11, 17, 18, 19, 13, 14, 15, 1, 2, 3]]
        np.testing.assert_allclose(by_joint, joints, atol=2e-6)
        np.testing.assert_allclose(points[4::4], vertices[TIPS[side]], atol=2e-6)
    assert seen == {(side, day) for side in TIPS for day in ("20200709", "20200820")}


def test_both_conventions_agree_on_right_hands_and_not_on_left_ones(root: Path, mano: Path) -> None:
    official = surfaces_of(DexYcb("test", recipe(root, mano)))
    data = DexYcb("test", recipe(root, mano, gt_mode="mirror_right"))
    mirrored = surfaces_of(data)
    for row in range(len(data)):
        apart = np.linalg.norm(official(row) - mirrored(row), axis=-1)
        assert (apart.max() > 1e-3) == bool(data.left[row])
        if not data.left[row]:
            np.testing.assert_array_equal(official(row), mirrored(row))
    assert data.left.any()
    assert not data.left.all()


def test_the_conventions_differ_by_the_releases_left_shapes_alone(root: Path, mano: Path) -> None:
    """With correctly mirrored shape directions, both conventions give the same."""
    data = DexYcb("test", recipe(root, mano))
    official = surfaces_of(data)
    mended = ManoPair(
        official.mano.right, ManoLayer.load(mano, "left", "dexycb", fix_left_shape=True)
    )
    parts = (mended, official.pose_m, official.betas, official.left)
    one, other = DexYcbSurfaces(*parts, "official"), DexYcbSurfaces(*parts, "mirror_right")
    for row in np.flatnonzero(data.left):
        np.testing.assert_allclose(one(int(row)), other(int(row)), atol=2e-6)


def test_test_samples_have_surfaces_mirrored_with_their_hands(root: Path, mano: Path) -> None:
    data = DexYcb("test", recipe(root, mano))
    surfaces = surfaces_of(data)
    for row in (int(np.argmax(data.left)), int(np.argmin(data.left))):
        sample = data[row]
        assert sample.vertices is not None
        turned = surfaces(row) * (MIRROR if data.left[row] else 1)
        np.testing.assert_allclose(sample.vertices, turned, atol=1e-6)
    for split in ("train", "val"):
        assert DexYcb(split, recipe(root, mano))[0].vertices is None


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ((None, "mano"), r"data.mano names no folder of MANO .*: vertex metrics are left out"),
        (("empty", "mano"), r"metrics are left out. No MANO hand at .*hand_recon.prepare mano"),
        (
            (None, "open"),
            r"cannot be compared vertex by vertex with hand=open: .*hand=mano has them",
        ),
    ],
)
def test_surfaces_that_cannot_be_made_or_compared_are_left_out_aloud(
    root: Path,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    choice: tuple[str | None, str],
    message: str,
) -> None:
    folder, topology = choice
    place = None if folder is None else tmp_path / folder
    data = DexYcb("test", recipe(root, place, topology=topology))
    assert data[0].vertices is None
    assert re.search(message, caplog.text)


def test_the_left_hand_is_needed_where_there_are_left_hands(mano: Path) -> None:
    pair = load_pair(mano, left_hands=False)
    assert pair is not None
    with pytest.raises(ValueError, match="MANO's left hand was not loaded"):
        pair.layer(left=True)


def test_training_hands_in_this_projects_parameters_are_the_labelled_hands(
    root: Path, mano: Path
) -> None:
    """The parameters give the label's surface; left hands give the mirrored right hand's."""
    data = DexYcbDataModule(
        root, crop=CropPolicy(32, "joints"), setup="s2", partial=True, label_workers=0, mano=mano,
        gt_mode="mirror_right",
    )  # fmt: skip
    parameters = data.train_parameters(9)
    assert parameters is not None
    training = data.dataset("train")
    assert isinstance(training, DexYcb)
    surfaces = surfaces_of(training)
    hand = surfaces.mano.right.hand.to_camera(parameters).vertices
    rows = [index * len(training) // 9 for index in range(9)]
    assert len(hand) == 9
    assert len(set(training.left[rows].tolist())) == 2
    for place, row in enumerate(rows):
        turned = surfaces(row) * (MIRROR if training.left[row] else 1)
        np.testing.assert_allclose(hand[place], turned, atol=5e-6)
    assert torch.equal(parameters.shape[0], torch.from_numpy(surfaces.betas[rows[0]]).float())


def test_a_look_at_the_training_hands_shows_their_surfaces(root: Path, mano: Path) -> None:
    data = DexYcbDataModule(
        root, setup="s2", partial=True, label_workers=0, mano=mano, topology="mano"
    )
    assert data.dataset("train")[0].vertices is None
    assert data.dataset_with_surfaces("train")[0].vertices is not None


def test_without_mano_there_are_no_parameters(root: Path) -> None:
    data = DexYcbDataModule(root, setup="s2", partial=True, label_workers=0)
    assert data.train_parameters() is None
