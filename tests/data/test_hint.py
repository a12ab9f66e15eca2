"""HInt: pairs of an image and a JSON file, occluded joints labelled, splits by the archive's folders."""

import json
from pathlib import Path
from typing import Any

import pytest

from hand_recon.data.crop import CropPolicy
from hand_recon.data.landmarks.hint import read_hint
from hand_recon.data.landmarks.image_files import scene
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from tests.support.dotted_images import Dotted, assert_same_points


def test_hidden_joints_are_labelled_and_the_name_tells_the_side(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    folder = dotted.as_hint()
    landmarks = read_hint(folder)
    assert_same_points(landmarks, dotted)
    assert landmarks.labelled.all()
    assert landmarks.occluded is not None
    assert landmarks.occluded[4].nonzero().flatten().tolist() == [0, 5, 10, 15, 20]
    assert landmarks.names[:2] == ("image0_l", "image0_r")
    assert landmarks.images[1] == folder / "image0_r.png"
    assert landmarks.hand_boxes is not None
    left, top, width, height = dotted.boxes()[1].tolist()
    assert landmarks.hand_boxes[1].tolist() == [left, top, left + width, top + height]


def test_the_archive_has_its_own_splits(tmp_path: Path) -> None:
    archive = tmp_path / "HInt"
    for folder, images in (("TRAIN_a_img", 4), ("TRAIN_b_img", 3), ("VAL_a_img", 2)):
        Dotted(tmp_path / folder, images).as_hint(str(archive / folder))
    assert [len(read_hint(archive, split)) for split in ("train", "val")] == [14, 4]
    with pytest.raises(FileNotFoundError, match="No pair of an image and a JSON file of test"):
        read_hint(archive, "test")
    # Validation is the archive's; a split without a folder is held out of training.
    recipe = LandmarkRecipe(archive, val_fraction=0.15, crop=CropPolicy(16, "joints"))
    splits = LandmarkSplits(recipe)
    assert {split: len(splits.dataset(split)) for split in ("train", "val", "test")} == {
        "train": 12, "val": 4, "test": 2,
    }  # fmt: skip
    assert splits.dataset("val")[0].source.startswith("VAL_a_img/")


def test_both_hands_of_an_image_are_in_one_split_under_their_two_names(tmp_path: Path) -> None:
    assert scene(Path("/a/b_l.jpg")) == scene(Path("/a/b_r.jpg")) == "/a/b"
    assert scene(Path("/a/b.jpg")) == "/a/b"
    folder = Dotted(tmp_path, images=8).as_hint()
    splits = LandmarkSplits(LandmarkRecipe(folder, crop=CropPolicy(16, "joints")))
    scenes = []
    for split in ("train", "val", "test"):
        data = splits.dataset(split)
        scenes.append({scene(data.hands.images[int(row)]) for row in data.rows})
    assert [len(one) for one in scenes] == [6, 1, 1]
    assert len(set.union(*scenes)) == 8


def test_hands_without_their_image_are_left_out_aloud(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = Dotted(tmp_path).as_hint()
    (folder / "image1_l.png").unlink()
    assert len(read_hint(folder)) == 5
    assert "1 of 6 hands are left out, as there are no images beside them" in caplog.text


def test_a_name_without_a_side_needs_one(tmp_path: Path) -> None:
    folder = Dotted(tmp_path).as_hint()
    for suffix in (".png", ".json"):
        (folder / f"image1_l{suffix}").rename(folder / f"image1{suffix}")
    with pytest.raises(ValueError, match="gives no side for 1 of 6 hands"):
        read_hint(folder)
    assert read_hint(folder, assumed=Assumptions(side="right")).left.sum() == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('[{"keypoints": [', "not complete JSON"),
        ([{"points": []}], "not one of HInt's files"),
        ([{"keypoints": [[1, 2]] * 20, "bbox": [[1, 2, 3, 4]]}], "`keypoints` must be 21 × 2 numbers"),
        ([{"keypoints": [[1, 2]] * 21, "bbox": [[1, 2, 3]]}], "`bbox` must be 4 numbers"),
        ([{"keypoints": [[1, 2]] * 21, "bbox": [[1, 2, 3, 4]]}], "`occlusion` must be 21 numbers"),
    ],
)  # fmt: skip
def test_every_mistake_names_its_file(tmp_path: Path, content: Any, message: str) -> None:  # noqa: ANN401
    folder = Dotted(tmp_path).as_hint()
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / "image1_l.json").write_text(text)
    with pytest.raises(ValueError, match=rf"image1_l\.json.*{message}"):
        read_hint(folder)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No folder .*nothing"):
        read_hint(tmp_path / "nothing")
