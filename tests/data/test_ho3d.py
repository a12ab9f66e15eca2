"""HO3D's loader returns the hands that its folder was written from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.ho3d.annotations import read_annotations
from hand_recon.data.ho3d.dataset import Ho3d, Ho3dRecipe
from hand_recon.data.ho3d.files import open_part
from hand_recon.schema import HandSample
from tests.support.freihand_folder import edit_json
from tests.support.ho3d_folder import (
    Folder,
    Hand,
    meta_of,
    write_folder,
    write_frame,
)

JOINTS = CropPolicy(size=96, around="joints")
BOX = CropPolicy(size=96, around="box")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return write_folder(tmp_path / "HO3D_v3")


def recipe(folder: Folder, **fields: Any) -> Ho3dRecipe:  # noqa: ANN401  # any field
    return replace(Ho3dRecipe(folder.root, crop=JOINTS, test_crop=BOX), **fields)


def agrees(sample: HandSample, hand: Hand) -> None:
    """Points to 1e-6 m, pixels of the image to 1e-3."""
    assert sample.landmarks_3d is not None
    assert sample.intrinsics is not None
    np.testing.assert_allclose(sample.landmarks_3d, hand.landmarks, atol=1e-6)
    # The crop's camera is the image's behind one matrix: it takes the image's pixels to the labels.
    matrix = sample.intrinsics.double().numpy() @ np.linalg.inv(hand.intrinsics)
    pixels = hand.pixels() @ matrix[:2, :2].T + matrix[:2, 2]
    np.testing.assert_allclose(sample.landmarks_2d, pixels, atol=1e-3)
    assert sample.labelled.all()


@pytest.mark.parametrize("version", ["v3", "v2"])
def test_every_frame_comes_back_in_this_projects_axes_and_order(
    tmp_path: Path, version: str
) -> None:
    folder = write_folder(tmp_path / "HO3D", version)
    data = {name: Ho3d(name, recipe(folder, version=version)) for name in ("train", "val", "test")}
    seen = []
    for split, dataset in data.items():
        hands = folder.evaluation if split == "test" else folder.train
        for index, frame in enumerate(dataset.frames):
            agrees(dataset[index], hands[frame])
            seen.append(frame)
            assert dataset[index].source.endswith((".jpg", ".png")[version == "v2"])
    # The list's order is the benchmark's; each frame is in one split.
    assert data["test"].frames == list(folder.evaluation)[::-1]
    assert sorted(seen) == sorted([*folder.train, *folder.evaluation])


def test_the_camera_projects_landmarks_to_labels_and_dots(folder: Folder) -> None:
    sample = Ho3d("train", recipe(folder))[0]
    assert sample.landmarks_3d is not None
    assert sample.intrinsics is not None
    projected = sample.landmarks_3d @ sample.intrinsics.T
    torch.testing.assert_close(
        projected[:, :2] / projected[:, 2:], sample.landmarks_2d, atol=1e-3, rtol=0
    )
    columns, rows = sample.landmarks_2d.int().T
    assert sample.image[1, rows, columns].float().mean() > 150
    assert sample.image[1].float().mean() < 110


def test_evaluation_crops_are_about_the_datasets_boxes(folder: Folder) -> None:
    data = Ho3d("test", recipe(folder, test_crop=CropPolicy(96, "box", 1.5)))
    for index, frame in enumerate(data.frames):
        hand, sample = folder.evaluation[frame], data[index]
        left, top, right, bottom = hand.box
        assert sample.intrinsics is not None
        scale = 96 / (1.5 * max(right - left, bottom - top))
        assert float(sample.intrinsics[0, 0]) == pytest.approx(hand.intrinsics[0, 0] * scale)
        middle = 48 + scale * (hand.intrinsics[0, 2] - (left + right) / 2)
        assert float(sample.intrinsics[0, 2]) == pytest.approx(middle, abs=1e-3)


def test_the_wrists_of_the_evaluation_are_there_for_a_submission(folder: Folder) -> None:
    data = Ho3d("test", recipe(folder))
    assert data.wrists is not None
    expected = [folder.evaluation[frame].landmarks[0] for frame in data.frames]
    np.testing.assert_allclose(data.wrists, expected, atol=1e-9)
    assert Ho3d("train", recipe(folder)).wrists is None


def test_vertices_of_the_evaluation_are_turned_into_the_camera(folder: Folder) -> None:
    data = Ho3d("test", recipe(folder, topology="mano"))
    for index, frame in enumerate(data.frames):
        found = data[index].vertices
        assert found is not None
        np.testing.assert_allclose(found, folder.evaluation[frame].vertices, atol=1e-6)
    assert Ho3d("val", recipe(folder))[0].vertices is None


def test_without_ground_truth_held_out_frames_test_aloud(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_folder(tmp_path / "HO3D_v3", ground_truth=False)
    data = Ho3d("test", recipe(folder))
    assert set(data.frames) < set(folder.train)
    agrees(data[0], folder.train[data.frames[0]])
    assert "not HO3D's benchmark" in caplog.text
    assert "put them into data.root, or name their folder as data.eval_root" in caplog.text


def test_without_ground_truth_the_evaluation_can_be_predicted_and_not_scored(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_folder(tmp_path / "HO3D_v3", ground_truth=False)
    data = Ho3d("test", recipe(folder, test_source="evaluation"))
    assert data.frames == list(folder.evaluation)[::-1]
    assert data[0].landmarks_3d is None
    assert not data[0].labelled.any()
    assert data.wrists is not None
    assert "predictions can be written, not scored" in caplog.text


def test_the_ground_truth_is_found_in_a_folder_of_its_own(folder: Folder, tmp_path: Path) -> None:
    beside = tmp_path / "truth"
    beside.mkdir()
    for name in ("evaluation_xyz.json", "evaluation_verts.json"):
        (folder.root / name).rename(beside / name)
    data = Ho3d("test", recipe(folder, eval_root=beside))
    agrees(data[1], folder.evaluation[data.frames[1]])


def test_a_recording_is_in_one_split_with_all_its_cameras(folder: Folder) -> None:
    for seed in range(6):
        fields = {"split_seed": seed, "test_source": "held_out", "val_fraction": 0.2}
        of_split = {
            split: {frame.split("/")[0] for frame in Ho3d(split, recipe(folder, **fields)).frames}
            for split in ("train", "val", "test")
        }
        assert set.union(*of_split.values()) == {name.split("/")[0] for name in folder.train}
        assert sum(map(len, of_split.values())) == 7
        cameras = [{"ABF10", "ABF11", "ABF12"} & names for names in of_split.values()]
        assert sorted(map(len, cameras)) == [0, 0, 3]


def test_who_validates_depends_on_the_split_seed_alone(folder: Folder) -> None:
    frames = {
        seed: [Ho3d("val", recipe(folder, split_seed=seed)).frames for _ in range(2)]
        for seed in range(5)
    }
    assert all(first == second for first, second in frames.values())
    assert len({tuple(first) for first, _ in frames.values()}) > 1


def test_one_recording_cannot_be_split(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "own", train={"ABF10": 2, "ABF11": 2})
    with pytest.raises(ValueError, match=r"1 recordings \(ABF1\) cannot be split"):
        Ho3d("train", recipe(folder))


def test_crops_around_joints_follow_a_changed_ground_truth(folder: Folder, tmp_path: Path) -> None:
    reading = ReadingPolicy(tmp_path / "cache")
    wanted = recipe(folder, test_crop=JOINTS, reading=reading)
    old = Ho3d("test", wanted)[0]
    edit_json(folder.root / "evaluation_xyz.json", lambda a: np.add(a, [0.01, 0, 0], out=a))
    new, decoded = (
        Ho3d("test", one)[0] for one in (wanted, replace(wanted, reading=ReadingPolicy()))
    )
    assert new.source == old.source
    assert not torch.equal(new.image, old.image)
    assert torch.equal(new.image, decoded.image)


def test_annotations_are_read_once(
    folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading = ReadingPolicy(tmp_path / "cache", decode_cache=False)
    part = open_part(folder.root, "train", "v3")
    first = read_annotations(part, reading)
    monkeypatch.setattr("hand_recon.data.ho3d.annotations.read_meta", None)
    again = read_annotations(part, reading)
    for name, array in vars(first).items():
        np.testing.assert_array_equal(array, getattr(again, name))
    assert not list(folder.root.rglob("*.npy"))


def test_a_changed_annotation_is_read_anew(folder: Folder, tmp_path: Path) -> None:
    reading = ReadingPolicy(tmp_path / "cache")
    fields = {"reading": reading, "test_source": "evaluation"}
    frame = Ho3d("train", recipe(folder, **fields)).frames[0]
    sequence = frame.split("/")[0]
    hand = folder.train[frame]
    moved = Hand(
        hand.landmarks + np.array([0.0, 0.0, 0.1]), hand.vertices, hand.intrinsics, hand.box
    )
    write_frame(folder.root / "train", frame, moved, meta_of(moved, training=True))
    data = Ho3d("train", recipe(folder, **fields))
    agrees(data[data.frames.index(frame)], moved)
    assert sequence in data[0].source
