import os
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import CropReader, ReadingPolicy
from hand_recon.data.freihand.dataset import FreiHand
from hand_recon.data.freihand.splits import FreiHandRecipe
from hand_recon.data.images import read_image
from tests.support.freihand_folder import SIZE, Folder, edit_json, image_number, write_folder

FULL = CropPolicy(size=SIZE)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return write_folder(tmp_path / "FreiHAND_pub_v2")


def test_images_are_read_as_red_green_blue(tmp_path: Path) -> None:
    blue_green_red = np.full((8, 8, 3), (10, 20, 200), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "red.png"), blue_green_red)
    image = read_image(tmp_path / "red.png")
    assert image is not None
    assert image[4, 4].tolist() == [200, 20, 10]


@pytest.mark.parametrize("content", [b"", b"not an image", b"\xff\xd8\xff\xda cut off"])
def test_what_is_no_image_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.jpg").write_bytes(content)
    assert read_image(tmp_path / "bad.jpg") is None
    assert read_image(tmp_path / "missing.jpg") is None


def read_everything(recipe: FreiHandRecipe) -> None:
    data = FreiHand("train", recipe)
    for index in range(len(data)):
        _ = data[index]


def damage(root: Path, count: int) -> list[Path]:
    """Cut off the first images of a training part."""
    paths = sorted((root / "training" / "rgb").iterdir())[:count]
    for path in paths:
        path.write_bytes(path.read_bytes()[:-40])
    return paths


@pytest.mark.parametrize("cached", [False, True])
def test_a_damaged_image_is_skipped_with_a_warning(
    folder: Folder, tmp_path: Path, caplog: pytest.LogCaptureFixture, cached: bool
) -> None:
    recipe = FreiHandRecipe(folder.root, FULL)
    number = image_number(FreiHand("train", recipe)[3].source)
    path = folder.root / "training" / "rgb" / f"{number:08d}.jpg"
    path.write_bytes(path.read_bytes()[:-40])
    reading = ReadingPolicy(cache_dir=tmp_path / "cache" if cached else None)
    data = FreiHand("train", FreiHandRecipe(folder.root, FULL, reading=reading))
    assert data[3].source == data[4].source
    assert data[3].index == 4
    assert caplog.text.count(f"Cannot read {path}") == 1


@pytest.mark.parametrize("cached", [False, True])
def test_too_many_damaged_images_stop_the_run_and_are_named(
    folder: Folder, tmp_path: Path, cached: bool
) -> None:
    paths = damage(folder.root, 30)
    reading = ReadingPolicy(cache_dir=tmp_path / "cache" if cached else None, max_corrupt=5)
    recipe = FreiHandRecipe(folder.root, FULL, reading=reading)
    with pytest.raises(RuntimeError, match=rf"6 images cannot be read.*{paths[0]}"):
        read_everything(recipe)


def test_the_cache_gives_what_decoding_gives(folder: Folder, tmp_path: Path) -> None:
    crop = CropPolicy(48, "joints")
    slow = FreiHand("train", FreiHandRecipe(folder.root, crop))
    fast = FreiHand(
        "train", FreiHandRecipe(folder.root, crop, reading=ReadingPolicy(tmp_path / "cache"))
    )
    for index in range(len(slow)):
        assert torch.equal(slow[index].image, fast[index].image)
        assert torch.equal(slow[index].landmarks_2d, fast[index].landmarks_2d)


def test_all_splits_share_one_map_and_the_dataset_folder_is_not_written(
    folder: Folder, tmp_path: Path
) -> None:
    before = sorted(folder.root.rglob("*"))
    recipe = FreiHandRecipe(folder.root, FULL, reading=ReadingPolicy(tmp_path / "cache"))
    for split in ("train", "val", "test"):
        _ = FreiHand(split, recipe)[0]
    assert len(list((tmp_path / "cache").rglob("crops.npy"))) == 1
    assert sorted(folder.root.rglob("*")) == before


def test_a_changed_label_or_image_makes_a_new_cache(folder: Folder, tmp_path: Path) -> None:
    recipe = FreiHandRecipe(folder.root, FULL, reading=ReadingPolicy(tmp_path / "cache"))
    old = FreiHand("val", recipe)[0]
    edit_json(folder.root / "training_xyz.json", lambda a: np.add(a, [0, 0.001, 0], out=a))
    image = folder.root / "training" / "rgb" / f"{image_number(old.source):08d}.jpg"
    other = folder.root / "training" / "rgb" / f"{(image_number(old.source) + 20):08d}.jpg"
    image.write_bytes(other.read_bytes())
    os.utime(image, ns=(1, 1))
    new = FreiHand("val", recipe)[0]
    assert new.source == old.source
    assert not torch.equal(new.landmarks_2d, old.landmarks_2d)
    assert not torch.equal(new.image, old.image)


def test_a_dataset_is_sent_to_workers_as_a_path(folder: Folder, tmp_path: Path) -> None:
    recipe = FreiHandRecipe(folder.root, CropPolicy(224), reading=ReadingPolicy(tmp_path / "cache"))
    data = FreiHand("train", recipe)
    image = data[0].image
    sent = pickle.dumps(data)
    assert len(sent) < data.part.landmarks.nbytes * 10 + image.nbytes
    assert torch.equal(pickle.loads(sent)[0].image, image)  # noqa: S301  # Pickled above.


def test_a_cache_that_was_never_finished_is_made_anew(folder: Folder, tmp_path: Path) -> None:
    recipe = FreiHandRecipe(folder.root, FULL, reading=ReadingPolicy(tmp_path / "cache"))
    FreiHand("val", recipe)
    made = next((tmp_path / "cache").rglob("crops.npy")).parent
    before = (made / "crops.npy").read_bytes()
    # As a killed run leaves it.
    made.rename(made.with_name(f"{made.name}.partial"))
    (made.with_name(f"{made.name}.partial") / "crops.npy").write_bytes(b"half")
    FreiHand("val", recipe)
    assert (made / "crops.npy").read_bytes() == before
    assert not list((tmp_path / "cache").rglob("*.partial"))


@pytest.mark.parametrize("cached", [False, True])
def test_a_damaged_image_that_was_mended_is_shown(
    folder: Folder, tmp_path: Path, cached: bool
) -> None:
    reading = ReadingPolicy(tmp_path / "cache" if cached else None)
    recipe = FreiHandRecipe(folder.root, FULL, reading=reading)
    path = folder.root / "training" / "rgb" / "00000000.jpg"
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    assert FreiHand("train", recipe).reader.read(0) is None
    path.write_bytes(whole)
    assert FreiHand("train", recipe).reader.read(0) is not None


def test_rewritten_masks_move_the_crops_around_them(folder: Folder, tmp_path: Path) -> None:
    crop = CropPolicy(48, "mask")
    recipe = FreiHandRecipe(folder.root, crop, reading=ReadingPolicy(tmp_path / "cache"))
    masks = folder.root / "training" / "mask"
    masks.mkdir()

    def write_masks(low: int) -> None:
        mask = np.zeros((SIZE, SIZE, 3), dtype=np.uint8)
        mask[low : low + 20, low : low + 20] = 255
        for number in range(len(folder.landmarks)):
            cv2.imwrite(str(masks / f"{number:08d}.jpg"), mask)

    write_masks(8)
    old = FreiHand("val", recipe)[0]
    write_masks(20)
    new = FreiHand("val", recipe)[0]
    # The same hand in a square of the same size whose corner is 12 pixels further right and down.
    assert new.source == old.source
    assert (old.landmarks_2d - new.landmarks_2d).amin() > 12


@pytest.mark.parametrize("row", [-1, 3, 80, 1000])
def test_a_row_that_is_not_in_the_map_is_refused(folder: Folder, tmp_path: Path, row: int) -> None:
    hands = FreiHand("train", FreiHandRecipe(folder.root, FULL)).hands
    rows = np.array([0, 1, 2, 5])
    reader = CropReader(hands, rows, FULL, ReadingPolicy(tmp_path / "cache"))
    assert all(reader.read(known) is not None for known in rows.tolist())
    with pytest.raises(
        KeyError, match=rf"Row {row} of freihand-training is not among the 4 in its"
    ):
        reader.read(row)
