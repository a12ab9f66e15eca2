from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.camera import project
from hand_recon.data.annotated_dataset import AnnotatedImages, ImageRecipe
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.schema import collate
from tests.support.annotated_images import annotated


@pytest.mark.parametrize("around", ["full", "joints", "box"])
def test_a_left_hand_comes_as_the_right_one_that_its_mirror_shows(
    tmp_path: Path, around: str
) -> None:
    table = annotated(tmp_path)
    data = AnnotatedImages(table, recipe=ImageRecipe(CropPolicy(96, around)))
    for index in range(3):
        sample = data[index]
        assert sample.mirrored == bool(index)
        assert table.landmarks_3d is not None
        assert sample.landmarks_3d is not None
        assert sample.vertices is not None
        assert sample.intrinsics is not None
        sign = torch.tensor([-1.0 if index else 1.0, 1.0, 1.0])
        ground_truth = torch.from_numpy(table.landmarks_3d[index]).float()
        torch.testing.assert_close(sample.landmarks_3d, ground_truth * sign)
        torch.testing.assert_close(sample.vertices, ground_truth[:5] * sign)
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
    recipe = ImageRecipe(CropPolicy(80, "joints"))
    mirrored = AnnotatedImages(table, recipe=recipe)
    plain = AnnotatedImages(replace(table, left=None), recipe=recipe)
    assert torch.equal(mirrored[0].image, plain[0].image)
    difference = mirrored[1].image.float() - plain[1].image.flip(-1).float()
    assert difference.abs().mean() < 1.0
    torch.testing.assert_close(mirrored[1].landmarks_2d[:, 0], 80 - plain[1].landmarks_2d[:, 0])


def test_left_hands_are_cached_mirrored_too(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    crop = CropPolicy(64, "joints")
    slow = AnnotatedImages(table, recipe=ImageRecipe(crop))
    fast = AnnotatedImages(table, recipe=ImageRecipe(crop, ReadingPolicy(tmp_path / "cache")))
    for index in range(3):
        assert torch.equal(slow[index].image, fast[index].image)
        assert torch.equal(slow[index].landmarks_2d, fast[index].landmarks_2d)


def test_splits_take_their_rows_from_one_table_and_one_cache(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    recipe = ImageRecipe(CropPolicy(64, "joints"), ReadingPolicy(tmp_path / "cache"))
    everything = np.arange(3)
    last = AnnotatedImages(table, np.array([2]), recipe, cached_rows=everything)
    first = AnnotatedImages(table, np.array([1, 0]), recipe, cached_rows=everything)
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
    data = AnnotatedImages(table, recipe=ImageRecipe(CropPolicy(64, "joints")))
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
    data = AnnotatedImages(annotated(tmp_path), recipe=ImageRecipe(CropPolicy(64)))
    assert collate([data[0]]).mirrored is None


def test_columns_of_unequal_length_are_refused(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    with pytest.raises(ValueError, match="dots: 2 images for 3 hands"):
        replace(table, images=[table.images[0], table.images[1]])
