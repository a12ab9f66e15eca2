"""Sets of synthetic hands on disk, and FreiHAND's layout."""

import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hand_recon.data.synthetic import image_store
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import SyntheticHand, synthetic_hand
from hand_recon.rehearsal.freihand import FreiHandFolder, write_freihand_layout
from hand_recon.schema import collate

SIZE = 48


def hands(
    folder: Path,
    split: str = "train",
    size: int = 6,
    *,
    workers: int = 0,
    with_vertices: bool | None = None,
) -> SyntheticHands:
    return SyntheticHands(
        split,
        size,
        SIZE,
        "medium",
        cache_dir=folder,
        workers=workers,
        with_vertices=with_vertices,
    )


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def training_set(cache: Path) -> SyntheticHands:
    return hands(cache)


def test_what_is_read_is_what_was_rendered(training_set: SyntheticHands) -> None:
    recipe = Recipe("train", level_named("medium"), SIZE, 0)
    drawn, sample = synthetic_hand(recipe, 4), training_set[4]
    assert (sample.image.numpy() == drawn.image.transpose(2, 0, 1)).all()
    np.testing.assert_allclose(sample.landmarks_2d, drawn.landmarks_2d, rtol=1e-5)
    assert sample.occluded is not None
    np.testing.assert_array_equal(sample.occluded, drawn.occluded)
    assert sample.landmarks_2d.dtype == torch.float32


def test_samples_stack_into_a_batch(training_set: SyntheticHands) -> None:
    batch = collate([training_set[i] for i in range(3)])
    assert batch.image.shape == (3, 3, SIZE, SIZE)
    assert batch.intrinsics is not None
    assert batch.occluded is not None


def test_the_number_of_workers_does_not_change_the_images(
    training_set: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(image_store, "CHUNK", 3)
    parallel = hands(tmp_path, workers=2)
    assert (parallel.images == training_set.images).all()
    assert torch.equal(parallel.landmarks_3d, training_set.landmarks_3d)


def test_an_interrupted_build_goes_on_where_it_stopped(
    training_set: SyntheticHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(image_store, "CHUNK", 2)
    rendered: list[int] = []

    def failing(recipe: Recipe, index: int) -> SyntheticHand:
        if index == 4 and len(rendered) < 5:
            rendered.append(index)
            raise KeyboardInterrupt
        rendered.append(index)
        return synthetic_hand(recipe, index)

    monkeypatch.setattr(image_store, "synthetic_hand", failing)
    with pytest.raises(KeyboardInterrupt):
        hands(tmp_path)
    assert not training_set.folder.name.endswith(".partial")
    assert [p.name.endswith(".partial") for p in tmp_path.iterdir() if p.is_dir()] == [True]
    resumed = hands(tmp_path)
    assert rendered == [0, 1, 2, 3, 4, 4, 5]
    assert (resumed.images == training_set.images).all()


def test_a_finished_set_is_not_rendered_again(
    cache: Path, training_set: SyntheticHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("rendered again")

    monkeypatch.setattr(image_store, "synthetic_hand", never)
    assert (hands(cache).images == training_set.images).all()


def test_a_finished_set_has_a_manifest_and_no_temporary_files(training_set: SyntheticHands) -> None:
    names = sorted(path.name for path in training_set.folder.iterdir())
    assert names == ["images.npy", "labels.npz", "manifest.json"]
    manifest = json.loads((training_set.folder / "manifest.json").read_text())
    assert manifest["recipe"]["level"]["name"] == "medium"
    assert manifest["size"] == 6
    assert manifest["images_per_second"] > 0


def test_another_seed_size_or_split_has_another_folder(cache: Path) -> None:
    recipe = Recipe("train", level_named("medium"), SIZE, 0)
    others = [
        (Recipe("train", level_named("medium"), SIZE, 1), 6),
        (Recipe("val", level_named("medium"), SIZE, 0), 6),
        (Recipe("train", level_named("medium"), SIZE, 0, "mano"), 6),
        (recipe, 7),
    ]
    paths = {image_store.store_path(cache, r, size) for r, size in [(recipe, 6), *others]}
    assert len(paths) == 5


def test_test_samples_have_the_vertices_of_their_landmarks(cache: Path) -> None:
    test_set = hands(cache, "test", 2)
    sample = test_set[1]
    posed = test_set.vertices(1)
    assert sample.vertices is not None
    assert sample.landmarks_3d is not None
    assert torch.equal(sample.vertices, posed)
    tip = sample.landmarks_3d[8]
    assert (posed - tip).norm(dim=1).min() < 0.008


def test_training_samples_have_no_vertices_unless_requested(
    training_set: SyntheticHands, cache: Path
) -> None:
    assert training_set[0].vertices is None
    assert hands(cache, with_vertices=True)[0].vertices is not None


def test_a_pickled_set_is_small_and_still_reads(training_set: SyntheticHands) -> None:
    assert training_set[0].image.numel() > 0
    packed = pickle.dumps(training_set)
    assert len(packed) < 40_000
    assert torch.equal(pickle.loads(packed)[2].image, training_set[2].image)  # noqa: S301


def test_reading_beyond_the_end_stops_a_loop(training_set: SyntheticHands) -> None:
    with pytest.raises(IndexError, match="6 of 6"):
        training_set[6]
    with pytest.raises(IndexError, match="-1 of 6"):
        training_set[-1]


def test_an_empty_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="size=0"):
        hands(tmp_path, size=0)


@pytest.fixture(scope="module")
def freihand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("freihand")
    write_freihand_layout(root, FreiHandFolder(unique=2, evaluation=1, with_mano=True))
    return root


def read_image(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path)))


def read(root: Path, name: str) -> np.ndarray:
    return np.array(json.loads((root / f"{name}.json").read_text()))


def test_freihand_files_have_their_names_counts_and_shapes(freihand: Path) -> None:
    assert len(list((freihand / "training/rgb").iterdir())) == 8
    assert len(list((freihand / "training/mask").iterdir())) == 2
    assert (freihand / "training/rgb/00000007.jpg").is_file()
    assert (freihand / "evaluation/rgb/00000000.jpg").is_file()
    assert read_image(freihand / "training/rgb/00000003.jpg").shape == (224, 224, 3)
    assert read(freihand, "training_K").shape == (2, 3, 3)
    assert read(freihand, "training_xyz").shape == (2, 21, 3)
    assert read(freihand, "training_scale").shape == (2,)
    assert read(freihand, "training_mano").shape == (2, 1, 61)
    assert read(freihand, "training_verts").shape[2] == 3
    assert read(freihand, "evaluation_xyz").shape == (1, 21, 3)
    assert read(freihand, "evaluation_verts").shape[0] == 1


def test_freihand_hands_lie_in_the_image_at_the_real_size_and_scale(freihand: Path) -> None:
    K, xyz = read(freihand, "training_K"), read(freihand, "training_xyz")
    points = np.einsum("nij,npj->npi", K, xyz)
    pixels = points[..., :2] / points[..., 2:]
    side = np.ptp(pixels, axis=1).max(axis=1)
    assert (side > 224 * 0.32).all()
    assert (side < 224 * 0.44).all()
    bone = np.linalg.norm(xyz[:, 9] - xyz[:, 10], axis=1)
    np.testing.assert_allclose(read(freihand, "training_scale"), bone, rtol=1e-6)


def test_freihand_mano_row_puts_the_root_where_it_is(freihand: Path) -> None:
    K, xyz = read(freihand, "training_K"), read(freihand, "training_xyz")
    row = read(freihand, "training_mano")[:, 0]
    focal = (K[:, 0, 0] + K[:, 1, 1]) / 2
    ray = np.column_stack([row[:, 58:60] - K[:, :2, 2], focal])
    np.testing.assert_allclose(ray / row[:, 60:], xyz[:, 9], atol=1e-6)


def test_freihand_versions_differ_only_outside_the_hand(freihand: Path) -> None:
    mask = read_image(freihand / "training/mask/00000001.jpg")[..., 0] > 150
    first, second = (read_image(freihand / f"training/rgb/{i:08d}.jpg").astype(int) for i in (1, 3))
    difference = np.abs(first - second).mean(axis=2)
    assert difference[~mask].mean() > 3 * difference[mask].mean()


def test_a_root_that_has_images_is_not_overwritten(freihand: Path) -> None:
    with pytest.raises(FileExistsError, match="training"):
        write_freihand_layout(freihand, FreiHandFolder(unique=1, evaluation=0))
