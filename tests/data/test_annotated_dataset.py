from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.camera import project
from hand_recon.data.annotated_dataset import PictureHands, PictureRecipe
from hand_recon.data.annotations import AnnotatedHands
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.schema import collate

SIZE = (120, 160)
"""Height and width of the pictures."""


def annotated(root: Path, left: tuple[bool, ...] = (False, True, True)) -> AnnotatedHands:
    """Hands with a white dot at each landmark; the last two share a picture."""
    rng = np.random.default_rng(4)
    hands = len(left)
    landmarks = rng.uniform((-0.03, -0.05, 0.55), (0.07, 0.05, 0.65), (hands, 21, 3))
    intrinsics = np.tile([[500.0, 0.0, 70.0], [0.0, 520.0, 66.0], [0.0, 0.0, 1.0]], (hands, 1, 1))
    on_plane = (landmarks / landmarks[..., 2:]) @ intrinsics.swapaxes(1, 2)
    labels = on_plane[..., :2]
    paths = [root / "a.png"] + [root / "b.png"] * (hands - 1)
    for path in set(paths):
        picture = np.zeros((*SIZE, 3), dtype=np.uint8)
        for row in (row for row in range(hands) if paths[row] == path):
            for u, v in labels[row]:
                cv2.circle(picture, (int(u), int(v)), 1, (255, 255, 255), -1)
        cv2.imwrite(str(path), picture)
    return AnnotatedHands(
        name="dots",
        root=root,
        pictures=paths,
        fingerprint="1",
        landmarks_2d=labels,
        left=np.array(left),
        intrinsics=intrinsics,
        landmarks_3d=landmarks,
        boxes=np.concatenate([labels.min(axis=1), labels.max(axis=1)], axis=-1),
        surfaces=lambda row: landmarks[row, :5],
    )


@pytest.mark.parametrize("around", ["full", "joints", "box"])
def test_a_left_hand_comes_as_the_right_one_that_its_mirror_shows(
    tmp_path: Path, around: str
) -> None:
    table = annotated(tmp_path)
    data = PictureHands(table, recipe=PictureRecipe(CropPolicy(96, around)))
    for index in range(3):
        sample = data[index]
        assert sample.mirrored == bool(index)
        assert table.landmarks_3d is not None
        assert sample.landmarks_3d is not None
        assert sample.vertices is not None
        assert sample.intrinsics is not None
        sign = torch.tensor([-1.0 if index else 1.0, 1.0, 1.0])
        truth = torch.from_numpy(table.landmarks_3d[index]).float()
        torch.testing.assert_close(sample.landmarks_3d, truth * sign)
        torch.testing.assert_close(sample.vertices, truth[:5] * sign)
        # The camera is a real one, and sees the mirrored hand where the mirrored pixels are.
        assert (sample.intrinsics[[0, 1], [0, 1]] > 0).all()
        torch.testing.assert_close(
            project(sample.landmarks_3d, sample.intrinsics), sample.landmarks_2d, atol=1e-3, rtol=0
        )
        columns, rows = sample.landmarks_2d.int().T
        inside = (columns >= 0) & (columns < 96) & (rows >= 0) & (rows < 96)
        assert inside.sum() > 15
        assert sample.image[0, rows[inside], columns[inside]].float().mean() > 120


def test_crops_of_left_hands_are_the_mirror_images_of_the_same_crops(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    recipe = PictureRecipe(CropPolicy(80, "joints"))
    mirrored = PictureHands(table, recipe=recipe)
    plain = PictureHands(replace(table, left=None), recipe=recipe)
    assert torch.equal(mirrored[0].image, plain[0].image)
    difference = mirrored[1].image.float() - plain[1].image.flip(-1).float()
    assert difference.abs().mean() < 1.0
    torch.testing.assert_close(mirrored[1].landmarks_2d[:, 0], 80 - plain[1].landmarks_2d[:, 0])


def test_left_hands_are_cached_mirrored_too(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    crop = CropPolicy(64, "joints")
    slow = PictureHands(table, recipe=PictureRecipe(crop))
    fast = PictureHands(table, recipe=PictureRecipe(crop, ReadingPolicy(tmp_path / "cache")))
    for index in range(3):
        assert torch.equal(slow[index].image, fast[index].image)
        assert torch.equal(slow[index].landmarks_2d, fast[index].landmarks_2d)


def test_splits_take_their_rows_from_one_table_and_one_cache(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    recipe = PictureRecipe(CropPolicy(64, "joints"), ReadingPolicy(tmp_path / "cache"))
    everything = np.arange(3)
    last = PictureHands(table, np.array([2]), recipe, cached_rows=everything)
    first = PictureHands(table, np.array([1, 0]), recipe, cached_rows=everything)
    assert len(list((tmp_path / "cache").rglob("crops.npy"))) == 1
    assert (len(last), last[0].index, last[0].source) == (1, 0, "b.png")
    assert [first[index].source for index in range(2)] == ["b.png", "a.png"]


def test_what_is_not_known_of_a_hand_is_absent_not_zero(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    assert table.intrinsics is not None
    assert table.landmarks_3d is not None
    table.intrinsics[1] = np.nan
    table.landmarks_3d[0] = np.nan
    table.landmarks_2d[0, 3:7] = np.nan
    data = PictureHands(table, recipe=PictureRecipe(CropPolicy(64, "joints")))
    assert data[1].intrinsics is None
    assert data[0].landmarks_3d is None
    assert data[0].labelled.tolist() == [index not in range(3, 7) for index in range(21)]
    assert data[0].landmarks_2d[3:7].isnan().all()
    batch = collate([data[0], data[1]])
    assert batch.landmarks_3d is not None
    assert batch.landmarks_3d[0].isnan().all()
    assert batch.mirrored is not None
    assert batch.mirrored.tolist() == [False, True]


def test_a_batch_of_right_hands_says_nothing_of_mirrors(tmp_path: Path) -> None:
    data = PictureHands(annotated(tmp_path), recipe=PictureRecipe(CropPolicy(64)))
    assert collate([data[0]]).mirrored is None


def test_columns_of_unequal_length_are_refused(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    with pytest.raises(ValueError, match="dots: 2 pictures for 3 hands"):
        replace(table, pictures=[table.pictures[0], table.pictures[1]])
