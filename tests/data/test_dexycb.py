"""DexYCB's samples: labels, sides, ids, dropped frames and errors."""

import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.dexycb import labels as labels_module
from hand_recon.data.dexycb.dataset import DexYcb, DexYcbRecipe
from hand_recon.data.dexycb.files import SERIALS, SUBJECTS
from hand_recon.rehearsal.dexycb import DexYcbFolder, write_dexycb_layout
from tests.support.dexycb_folder import camera_of, edit_labels, first_sequence, label_of, meta_of

SMALL = CropPolicy(64, "joints", 1.5)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Subjects 1 and 3, sequences 0, 19, 38 …, two frames of each camera."""
    root = tmp_path_factory.mktemp("dexycb") / "dex-ycb"
    write_dexycb_layout(root, DexYcbFolder(subjects=(0, 2), frames=2, every=38))
    return root


@pytest.fixture
def root(written: Path, tmp_path: Path) -> Path:
    """A copy to damage."""
    shutil.copytree(written, tmp_path / "dex-ycb")
    return tmp_path / "dex-ycb"


def recipe(root: Path, **changes: object) -> DexYcbRecipe:
    fields: dict[str, object] = {"setup": "s2", "partial": True, "crop": SMALL, "label_workers": 0}
    return DexYcbRecipe(root, **(fields | changes))  # type: ignore[arg-type]  # of the right types


def test_labels_are_the_projections_of_the_landmarks(written: Path) -> None:
    data = DexYcb("train", recipe(written))
    for index in range(len(data)):
        label = label_of(written, data.hands.source(index))
        points, camera = (
            label["joint_3d"][0].astype(float),
            camera_of(written, data.hands.source(index)),
        )
        for landmark in range(21):
            u, v, w = camera @ points[landmark]
            np.testing.assert_allclose(label["joint_2d"][0, landmark], [u / w, v / w], atol=1e-3)
        np.testing.assert_array_equal(data.hands.landmarks_2d[index], label["joint_2d"][0])
        assert data.hands.landmarks_3d is not None
        np.testing.assert_array_equal(data.hands.landmarks_3d[index], label["joint_3d"][0])


def test_left_hands_come_mirrored_as_meta_yml_says_and_stand_before_a_real_camera(
    written: Path,
) -> None:
    data = DexYcb("train", recipe(written))
    sides = set()
    for index in range(0, len(data), 3):
        sample = data[index]
        left = meta_of(written, sample.source)["mano_sides"][0] == "left"
        sides.add(left)
        assert sample.mirrored == left
        assert sample.landmarks_3d is not None
        assert sample.intrinsics is not None
        points = torch.from_numpy(label_of(written, sample.source)["joint_3d"][0])
        torch.testing.assert_close(
            sample.landmarks_3d, points * torch.tensor([-1.0 if left else 1.0, 1, 1])
        )
        pixels = (sample.landmarks_3d / sample.landmarks_3d[:, 2:]) @ sample.intrinsics.T
        torch.testing.assert_close(pixels[:, :2], sample.landmarks_2d, atol=2e-3, rtol=0)
        assert bool((sample.intrinsics[[0, 1], [0, 1]] > 0).all())
        # The painted hand is redder than what is behind it, wherever a landmark is.
        columns, rows = sample.landmarks_2d.int().T
        assert (sample.image[0, rows, columns].float() > 75).float().mean() > 0.85
    assert sides == {True, False}


def test_ids_count_every_frame_whether_it_shows_a_hand_or_not(written: Path) -> None:
    """Subjects, sequences, then cameras, then frames: sequences 0, 38, 76 of two subjects."""
    data = DexYcb("train", recipe(written))
    expected, number = [], 0
    for subject in (0, 2):
        for sequence in sorted((written / SUBJECTS[subject]).iterdir()):
            for serial in SERIALS[:6]:
                for image in sorted((sequence / serial).glob("color_*.jpg")):
                    source = image.relative_to(written).as_posix()
                    if not (label_of(written, source)["joint_3d"] == -1).all():
                        expected.append((number, source))
                    number += 1
    assert number == 2 * 3 * 6 * 2
    assert 0 < len(expected) < number
    sources = [data.hands.source(row) for row in range(len(data))]
    assert list(zip(data.ids.tolist(), sources, strict=True)) == expected
    assert [data[index].index for index in range(3)] == [0, 1, 2]


def test_frames_without_a_hand_are_dropped_aloud_and_by_rule(
    root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One more of the 12 frames of camera 7 loses its 2D labels, and one its pose."""
    before = len(DexYcb("test", recipe(root)))
    shown = [
        path for path in sorted(root.glob(f"2*/*/{SERIALS[7]}/labels_*.npz"))
        if not (np.load(path)["joint_3d"] == -1).all()
    ]  # fmt: skip
    for path, name, value in ((shown[0], "joint_2d", -1), (shown[1], "pose_m", 0)):
        label = {key: np.array(array) for key, array in np.load(path).items()}
        label[name][:] = value
        np.savez(path, **label)  # type: ignore[arg-type]  # the arrays are named
    caplog.clear()
    with caplog.at_level(logging.INFO):
        assert len(DexYcb("test", recipe(root))) == before - 2
    gone = 12 - before
    assert (
        f"dropped {gone + 2} of 12 frames without a labelled hand (all of joint_3d is −1: {gone}, "
        f"joint_2d is −1: {gone + 1}, pose_m is 0: {gone + 1}); {before - 2} are left"
        in caplog.text
    )
    assert (
        "2 of the dropped frames have joint_3d, which the official evaluation scores" in caplog.text
    )


def test_a_split_without_any_hand_is_refused(root: Path) -> None:
    edit_labels(root, lambda label: label["joint_3d"].fill(-1))
    with pytest.raises(ValueError, match=r"None of the 12 frames of DexYCB s2-test shows"):
        DexYcb("test", recipe(root))


def test_labels_are_read_once_and_anew_when_one_is_rewritten(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading = ReadingPolicy(tmp_path / "cache", decode_cache=False)
    first = DexYcb("test", recipe(root, reading=reading))
    folder = (root / first.hands.source(0)).parent
    label = folder / "labels_000000.npz"
    content, changed = label.read_bytes(), folder.stat().st_mtime_ns
    with monkeypatch.context() as patched:
        patched.setattr(labels_module, "_read_all", None)
        second = DexYcb("test", recipe(root, reading=reading))
    np.testing.assert_array_equal(first.labels.joint_3d, second.labels.joint_3d)
    # As many bytes, in a file that stayed, in a folder that does not change.
    label.write_bytes(bytes(len(content)))
    assert folder.stat().st_mtime_ns == changed
    with pytest.raises(ValueError, match=rf"{label.name} cannot be read as DexYCB's labels"):
        DexYcb("test", recipe(root, reading=reading))


def test_an_image_that_is_mended_in_place_is_decoded_and_labels_are_not_read_again(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading = ReadingPolicy(tmp_path / "cache")
    whole = DexYcb("test", recipe(root))
    image = root / whole.hands.source(0)
    content = image.read_bytes()
    image.write_bytes(content[:-40])
    assert DexYcb("test", recipe(root, reading=reading)).reader.read(0) is None
    image.write_bytes(content)
    monkeypatch.setattr(labels_module, "_read_all", None)
    mended = DexYcb("test", recipe(root, reading=reading)).reader.read(0)
    assert mended is not None
    assert np.array_equal(mended.pixels, whole[0].image)


def test_folders_are_looked_at_once_per_start(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = Mock(wraps=os.scandir)
    monkeypatch.setattr("hand_recon.data.dexycb.listing.os.scandir", looked)
    DexYcb("test", recipe(written, reading=ReadingPolicy(tmp_path / "cache")))
    cameras = [one for call in looked.call_args_list if (one := call.args[0]).name in SERIALS]
    assert len(cameras) == len(set(cameras)) == 6


def test_processes_read_what_one_process_reads(
    written: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = DexYcb("val", recipe(written))
    monkeypatch.setattr(labels_module, "WORTH_PROCESSES", 0)
    together = DexYcb("val", recipe(written, label_workers=2))
    for name, array in vars(alone.labels).items():
        np.testing.assert_array_equal(array, getattr(together.labels, name))


def _object_array(path: Path) -> None:
    np.savez(path, joint_2d=np.array([{}], dtype=object), joint_3d=0, pose_m=0)


@pytest.mark.parametrize(
    ("damage", "error", "message"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:500]), ValueError, "cannot be read as"),
        (lambda path: np.savez(path, joint_3d=0), ValueError, "cannot be read as .*joint_2d"),
        (_object_array, ValueError, "cannot be read as .*array of objects"),
        (lambda path: np.savez(path, joint_2d=np.ones((2, 21, 2)), joint_3d=0, pose_m=0),
         ValueError, r"joint_2d of shape \[2, 21, 2\], expected \[1, 21, 2\]"),
        (lambda path: path.unlink(), FileNotFoundError, "although meta.yml counts it"),
        (lambda path: shutil.rmtree(path.parent), FileNotFoundError, "has the images of eight"),
    ],
)  # fmt: skip
def test_a_label_that_is_damaged_or_missing_is_named(
    root: Path, damage: Callable[[Path], object], error: type[Exception], message: str
) -> None:
    folder = first_sequence(root, 2, every=38) / SERIALS[7]
    damage(folder / "labels_000001.npz")
    with pytest.raises(error, match=message) as caught:
        DexYcb("test", recipe(root))
    assert str(folder) in str(caught.value)


def test_no_folder_names_the_variable(root: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"give data.root=.*, or set DEX_YCB_DIR"):
        DexYcb("test", DexYcbRecipe(None))
    with pytest.raises(FileNotFoundError, match=r"No folder .*nowhere. Unpack DexYCB there"):
        DexYcb("test", recipe(tmp_path / "nowhere"))
    for wrong in (root.parent, root / "calibration", root / SUBJECTS[0]):
        with pytest.raises(FileNotFoundError, match=rf"set data.root={root}\."):
            DexYcb("test", recipe(wrong))
    (tmp_path / "empty").mkdir()
    shutil.rmtree(root)
    with pytest.raises(FileNotFoundError, match="holds no subject of DexYCB; expected 20200709"):
        DexYcb("test", recipe(tmp_path / "empty"))


def test_missing_subjects_are_refused_unless_wanted_and_then_said_aloud(
    written: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(
        FileNotFoundError, match=r"lacks 1 of the 2 subjects of DexYCB s0-val: 20200813"
    ):
        DexYcb("val", recipe(written, setup="s0", partial=False))
    with pytest.raises(FileNotFoundError, match=r"lacks 2 of the 2 .*choose a data.setup whose"):
        DexYcb("test", recipe(written, setup="s1"))
    # Sequence 38 of 0, 38, 76 is none of the fives' last; subject 3 is none of s0's validation.
    with pytest.raises(ValueError, match=r"None of the 0 frames of DexYCB s0-val"):
        DexYcb("val", recipe(written, setup="s0"))
    data = DexYcb("train", recipe(written, setup="s1"))
    assert "s1-train without 20200813-subject-02, 20200903-subject-04" in caplog.text
    assert "neither are the ids" in caplog.text
    assert {Path(data.hands.source(row)).parts[0] for row in range(len(data))} == {
        SUBJECTS[0], SUBJECTS[2]}  # fmt: skip


def test_a_thinned_test_part_is_not_the_benchmark(
    written: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data = DexYcb("test", recipe(written, test_every=5))
    assert set(data.ids.tolist()) <= {0, 5, 10}
    assert "every 5-th frame only: numbers are not the benchmark's" in caplog.text
    with pytest.raises(ValueError, match=r"are \[1, 1, 0\]; all must be 1 or more"):
        recipe(written, test_every=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda label: np.multiply(label["joint_3d"], 1000, out=label["joint_3d"],
                                   where=label["joint_3d"] != -1), "apart in the median, expected"),
        (lambda label: np.add(label["joint_2d"], 9, out=label["joint_2d"],
                              where=label["joint_2d"] != -1), r"not the projection .* 9.0 px off"),
        (lambda label: np.multiply(label["joint_3d"], [1, -1, -1], out=label["joint_3d"],
                                   where=label["joint_3d"] != -1), "not the projection"),
    ],
)  # fmt: skip
def test_labels_that_are_no_hands_in_metres_before_the_camera_are_refused(
    root: Path, change: Callable[[dict[str, np.ndarray]], None], message: str
) -> None:
    edit_labels(root, change)
    with pytest.raises(ValueError, match=message):
        DexYcb("test", recipe(root))


def test_images_of_another_size_are_refused(root: Path) -> None:
    for path in root.glob("2*/*/*/color_*.jpg"):
        cv2.imwrite(str(path), np.zeros((240, 320, 3), np.uint8))
    with pytest.raises(ValueError, match=r"has 320 × 240 pixels; .* are for 640 × 480"):
        DexYcb("test", recipe(root))


def test_a_choice_that_does_not_exist_is_refused(written: Path) -> None:
    with pytest.raises(ValueError, match="Unknown setup 's5'"):
        recipe(written, setup="s5")
    with pytest.raises(ValueError, match="Unknown gt_mode 'fixed'"):
        recipe(written, gt_mode="fixed")
    with pytest.raises(ValueError, match="Unknown split 's2' 'testing'"):
        DexYcb("testing", recipe(written))


def test_the_writer_overwrites_nothing(written: Path) -> None:
    with pytest.raises(FileExistsError, match="is not empty; choose another root"):
        write_dexycb_layout(written, DexYcbFolder())
