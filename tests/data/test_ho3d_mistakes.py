"""Incomplete or wrong HO3D folders: frames skipped with a warning, and errors."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hand_recon.data.crop import CropPolicy
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.data.ho3d.files import open_part
from hand_recon.data.ho3d.metas import RefusedMetaError
from hand_recon.hand.skeleton import LANDMARK_ORDERS, landmark_permutation
from tests.support.ho3d_folder import (
    FLIP,
    Folder,
    edit_meta,
    write_folder,
    write_json,
)

JOINTS = CropPolicy(size=96, around="joints")
BOX = CropPolicy(size=96, around="box")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return write_folder(tmp_path / "HO3D_v3")


def recipe(folder: Folder, **fields: Any) -> Ho3dRecipe:  # noqa: ANN401  # any field
    return replace(Ho3dRecipe(folder.root, crop=JOINTS, test_crop=BOX), **fields)


def test_frames_without_annotation_are_skipped_aloud(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    """A frame of the list whose meta has only a camera."""
    path = folder.root / "train.txt"
    path.write_text(path.read_text() + "MC1/0012\n")
    data = Ho3d("train", recipe(folder)).frames + Ho3d("val", recipe(folder)).frames
    assert sorted(data) == sorted(folder.train)
    assert "1 of the 26 frames" in caplog.text
    assert "no annotation in their meta and are left out; the first are MC1/0012" in caplog.text


def test_frames_without_files_are_left_out_aloud(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    (folder.root / "train" / "ND2" / "rgb" / "0003.jpg").unlink()
    folder.meta("MC1/0006").unlink()
    data = Ho3d("train", recipe(folder)).frames + Ho3d("val", recipe(folder)).frames
    assert sorted(data) == sorted(set(folder.train) - {"ND2/0003", "MC1/0006"})
    assert "2 of the 25 frames" in caplog.text
    assert "ND2/0003" in caplog.text
    assert "MC1/0006" in caplog.text


def test_counts_are_told_against_the_full_set(
    tmp_path: Path, folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        Ho3d("train", recipe(folder))
    assert "lists 25 frames, the full HO3D v3 83325" in caplog.text
    assert "25 of 25 frames are there" in caplog.text
    path = folder.root / "evaluation.txt"
    path.write_text("".join(f"AP10/{number:05d}\n" for number in range(11_523)) + "AP10/0000\n")
    open_part(folder.root, "evaluation", "v3")
    assert "as many as HO3D v2 has and not v3: set data.version=v2" in caplog.text


@pytest.mark.parametrize("frame", ["ABF10/0003", "SMu40/0000"])
def test_a_damaged_meta_is_named_with_the_cure(folder: Folder, frame: str) -> None:
    path = folder.meta(frame)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RefusedMetaError, match=rf"{frame.replace('/', '/meta/')}\.pkl .*Unpack"):
        Ho3d("train", recipe(folder))


@pytest.mark.parametrize("order", sorted(set(LANDMARK_ORDERS) - {"ho3d"}))
def test_another_order_of_landmarks_is_refused_by_name(folder: Folder, order: str) -> None:
    for frame in folder.train:
        change_landmarks(folder, frame, lambda a: a[list(landmark_permutation("ho3d", order))])
    with pytest.raises(ValueError, match=rf"seem to be in that of '{order}'"):
        Ho3d("train", recipe(folder))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda a: a * FLIP,
            r"25 of 25 hands are behind .*OpenCV's axes \(z > 0\) already, multiply",
        ),
        (lambda a: a * 1000, r"it is 105\.8 in the median, expected about 0\.1.*metres"),
    ],
)
def test_other_axes_and_units_are_refused(
    folder: Folder, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    for frame in folder.train:
        change_landmarks(folder, frame, change)
    with pytest.raises(ValueError, match=message):
        Ho3d("train", recipe(folder))


def test_one_hand_behind_the_camera_is_named(folder: Folder) -> None:
    change_landmarks(folder, "ND2/0006", lambda a: a * FLIP)
    with pytest.raises(ValueError, match=r"1 of 25 hands .* the first are ND2/0006"):
        Ho3d("train", recipe(folder))


def test_cameras_of_other_images_are_refused(folder: Folder) -> None:
    def enlarge(meta: dict[str, Any]) -> None:
        meta["camMat"] = np.diag([8.0, 8.0, 1.0]) @ meta["camMat"]

    for frame in folder.train:
        edit_meta(folder.meta(frame), enlarge)
    with pytest.raises(ValueError, match=r"25 of 25 wrists project outside .*160 × 120 pixels"):
        Ho3d("train", recipe(folder))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a[:-1], r"6 × 21 × 3, expected 7 × 21 × 3.*same version"),
        (lambda a: a * FLIP, r"has OpenCV's axes"),
        (lambda a: a[::-1], r"puts the wrists .* of this list in another order"),
        (lambda a: a * 1000, r"or not in metres"),
    ],
)
def test_a_ground_truth_of_other_frames_is_refused(
    folder: Folder, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    path = folder.root / "evaluation_xyz.json"
    ground_truth = np.stack([hand.landmarks for hand in folder.evaluation.values()])[::-1]
    order = list(landmark_permutation("freihand", "ho3d"))
    write_json(path, list(change(ground_truth[:, order] * FLIP)))
    with pytest.raises(ValueError, match=message):
        Ho3d("test", recipe(folder))


def test_surfaces_are_compared_with_a_hand_like_theirs(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    assert Ho3d("test", recipe(folder, vertices=None))[0].vertices is not None
    assert "vertices" not in caplog.text
    assert Ho3d("test", recipe(folder, vertices=500))[0].vertices is None
    assert "surfaces of 778 vertices, the hand model 500" in caplog.text


def test_truth_without_surfaces_scores_landmarks(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    (folder.root / "evaluation_verts.json").unlink()
    assert Ho3d("test", recipe(folder))[0].vertices is None
    assert "No evaluation_verts.json" in caplog.text


def test_missing_folders_and_lists_name_the_cure(folder: Folder, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No folder .*or run data=synthetic"):
        Ho3d("train", Ho3dRecipe(tmp_path / "nowhere"))
    with pytest.raises(FileNotFoundError, match=r"set data.root=.*HO3D_v3\."):
        Ho3d("train", Ho3dRecipe(folder.root.parent))
    (folder.root / "train").rename(folder.root / "elsewhere")
    with pytest.raises(FileNotFoundError, match=r"None of the 25 frames .*Unpack HO3D_v3\.zip"):
        Ho3d("train", recipe(folder))
    (folder.root / "train.txt").unlink()
    with pytest.raises(FileNotFoundError, match=r"No train.txt in .*HO3D_v3\.zip"):
        Ho3d("train", recipe(folder))


@pytest.mark.parametrize("lines", ["../../etc/0000", "MC1\n", "MC1/0000\nMC1/0000", ""])
def test_a_list_of_something_else_is_refused(folder: Folder, lines: str) -> None:
    (folder.root / "train.txt").write_text(lines)
    with pytest.raises(ValueError, match=r"train\.txt.* expected"):
        Ho3d("train", recipe(folder))


def test_a_choice_that_does_not_exist_is_refused(folder: Folder) -> None:
    with pytest.raises(ValueError, match="Unknown split 'training'"):
        Ho3d("training", recipe(folder))
    for field, value in (("test_source", "val"), ("version", "v1"), ("val_fraction", 0.7)):
        with pytest.raises(ValueError, match=field if field != "version" else "HO3D version 'v1'"):
            recipe(folder, **{field: value})


def change_landmarks(
    folder: Folder, frame: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Change the joints of a meta as they are in the file."""

    def edit(meta: dict[str, Any]) -> None:
        meta["handJoints3D"] = change(meta["handJoints3D"])

    edit_meta(folder.meta(frame), edit)
