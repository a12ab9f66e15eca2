"""The layout writer and the loader agree, and a run on a written folder completes."""

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.crop import CropPolicy
from hand_recon.data.ho3d.datamodule import Ho3dDataModule
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.data.synthetic.scene import synthetic_view
from hand_recon.rehearsal.ho3d import Ho3dFolder, write_ho3d_layout
from hand_recon.runs.building import build_data
from hand_recon.runs.evaluation_run import evaluate
from hand_recon.runs.training_run import train
from tests.support.configurations import composed, settings
from tests.support.small_runs import LIGHTNING_WARNINGS, SMALL

pytestmark = LIGHTNING_WARNINGS

WRITTEN = Ho3dFolder(frames=3, evaluation_frames=3, size=(64, 48))


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written") / "HO3D_v3"
    write_ho3d_layout(folder, WRITTEN)
    return folder


def test_the_tree_is_ho3ds(root: Path) -> None:
    lists = {part: (root / f"{part}.txt").read_text().split() for part in ("train", "evaluation")}
    assert lists["train"][:6] == [
        "ABF10/0000", "ABF11/0000", "MC1/0000", "ND2/0000", "SM2/0000", "ABF10/0001",
    ]  # fmt: skip
    for part, frames in lists.items():
        for frame in frames:
            sequence, number = frame.split("/")
            assert (root / part / sequence / "rgb" / f"{number}.jpg").is_file()
            assert (root / part / sequence / "meta" / f"{number}.pkl").is_file()
    # One more frame of each sequence has an image and no annotation.
    assert len(list(root.glob("train/*/rgb/*.jpg"))) == len(lists["train"]) + 5
    content = (root / "train" / "MC1" / "meta" / "0003.pkl").read_bytes()
    assert content[:2] == b"\x80\x02"
    meta = pickle.loads(content, encoding="latin1")  # noqa: S301  # the test's own
    assert meta["handJoints3D"] is None
    ground_truth = np.array(json.loads((root / "evaluation_xyz.json").read_text()))
    assert ground_truth.shape == (6, 21, 3)
    assert (ground_truth[..., 2] < 0).all()


def test_evaluation_metas_have_the_wrist_and_a_box_alone(root: Path) -> None:
    content = (root / "evaluation" / "SM1" / "meta" / "0001.pkl").read_bytes()
    meta = pickle.loads(content, encoding="latin1")  # noqa: S301  # the test's own
    assert meta["handJoints3D"].shape == (3,)
    assert "handPose" not in meta
    left, top, right, bottom = meta["handBoundingBox"]
    assert 0 <= left < right <= 64
    assert 0 <= top < bottom <= 48


def test_the_loader_finds_the_hands_that_were_written(root: Path) -> None:
    """The samples equal the generated hand, before axes and order were changed."""
    crop = CropPolicy(size=48, around="joints")
    data = Ho3d("test", Ho3dRecipe(root, crop=crop, test_crop=CropPolicy(48, "box")))
    focal = []
    for index, frame in enumerate(data.frames):
        sequence, number = frame.split("/")
        place = WRITTEN.evaluation_sequences.index(sequence)
        hand = synthetic_view(WRITTEN.recipe("test", place), place * 4 + int(number))
        sample = data[index]
        assert sample.landmarks_3d is not None
        np.testing.assert_allclose(sample.landmarks_3d, hand.landmarks_3d, atol=1e-6)
        assert sample.intrinsics is not None
        on_plane = sample.landmarks_3d @ sample.intrinsics.T
        pixels = on_plane[:, :2] / on_plane[:, 2:]
        np.testing.assert_allclose(pixels, sample.landmarks_2d, atol=1e-3)
        assert sample.vertices is not None
        focal.append(
            (sequence, round(float(data.annotations.intrinsics[data.rows[index], 0, 0]), 6))
        )
    # One camera per sequence, and not the same for all.
    assert len(set(focal)) == len(set(dict(focal).values())) == 2


def test_version_2_has_png_images_and_no_contact(tmp_path: Path) -> None:
    written = Ho3dFolder(
        "v2", ("ABF10", "MC1"), 1, ("SM1",), 1, unannotated=0, with_vertices=False, size=(64, 48)
    )
    write_ho3d_layout(tmp_path / "HO3D_v2", written)
    assert len(list(tmp_path.glob("HO3D_v2/train/*/rgb/0000.png"))) == 2
    content = (tmp_path / "HO3D_v2" / "train" / "MC1" / "meta" / "0000.pkl").read_bytes()
    assert b"handVertContact" not in content
    assert not (tmp_path / "HO3D_v2" / "evaluation_verts.json").exists()
    data = Ho3d("train", Ho3dRecipe(tmp_path / "HO3D_v2", "v2", crop=CropPolicy(48, "joints")))
    assert len(data) == 1


def test_nothing_is_overwritten_and_nothing_is_not_written(root: Path, tmp_path: Path) -> None:
    with pytest.raises(FileExistsError, match="exists already; choose another root"):
        write_ho3d_layout(root, WRITTEN)
    with pytest.raises(ValueError, match=r"Unknown HO3D version 'v1'"):
        write_ho3d_layout(tmp_path / "new", Ho3dFolder("v1"))
    with pytest.raises(ValueError, match="0 frames of 5 sequences"):
        write_ho3d_layout(tmp_path / "new", Ho3dFolder(frames=0))


def test_the_configuration_builds_it() -> None:
    data = build_data(composed("data=ho3d", "data.root=/nowhere", "data.version=v2"))
    assert isinstance(data, Ho3dDataModule)
    assert data.landmark_set == "ho3d"
    assert data.recipe.version == "v2"
    assert (data.recipe.crop.around, data.recipe.crop.expansion) == ("joints", 1.5)
    assert data.recipe.test_crop is not None
    assert (data.recipe.test_crop.around, data.recipe.test_crop.expansion) == ("box", 1.5)


@pytest.mark.slow
def test_an_ho3d_folder_trains_and_is_evaluated(root: Path, tmp_path: Path) -> None:
    root = shutil.copytree(root, tmp_path / "HO3D_v3")
    small = [text for text in SMALL if not text.startswith(("data.", "synthetic", "trainer.max"))]
    data = [
        "data=ho3d", f"data.root={root}", "data.batch_size=4", "data.reading.workers=1",
        f"data.mano={tmp_path}",
    ]  # fmt: skip
    cache, run = tmp_path / "cache", tmp_path / "run"
    # Eight or so training frames in batches of four: two steps.
    metrics = train(settings(cache, run, *small, *data, "hand=open", "trainer.max_epochs=1"))
    assert {"E_J", "E_V", "E_2D"} <= set(metrics["test"])
    again = evaluate(
        settings(cache, tmp_path / "again", f"ckpt={run}", "threads=1", name="evaluate")
    )
    assert again["test"] == pytest.approx(metrics["test"], rel=1e-6)
    # Without ground truth, the evaluation part is predicted, and no score needs a label.
    (root / "evaluation_xyz.json").unlink()
    blind = evaluate(
        settings(
            cache,
            tmp_path / "blind",
            f"ckpt={run}",
            *data,
            "data.test_source=evaluation",
            "threads=1",
            name="evaluate",
        )
    )
    assert not {"E_J", "E_V", "E_2D"} & set(blind["test"])
