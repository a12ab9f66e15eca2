"""Landmarks without images: the same labels as with images, noisy in every split, and upright."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.camera import project
from hand_recon.data.synthetic import image_store
from hand_recon.data.synthetic.datamodule import SyntheticDataModule
from hand_recon.data.synthetic.dataset import SyntheticHands
from hand_recon.data.synthetic.recipe import Recipe, level_named
from hand_recon.data.synthetic.scene import SyntheticView, synthetic_hand, synthetic_view
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.upright import FILL
from hand_recon.schema import HandBatch, collate
from tests.support.tolerance import assert_close

SIZE = 150


def hands(folder: Path, split: str = "test", size: int = SIZE) -> SyntheticHands:
    return SyntheticHands(split, size, 224, "hard", cache_dir=folder, pictures=False)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def detected(cache: Path) -> SyntheticHands:
    return hands(cache)


@pytest.fixture(scope="module")
def stored(detected: SyntheticHands) -> dict[str, np.ndarray]:
    """Labels on disk, before the upright crops."""
    with np.load(detected.folder / "labels.npz") as archive:
        return {name: archive[name] for name in archive.files}


NAMES = [field.name for field in fields(SyntheticView)]


@pytest.mark.parametrize("split", ["train", "test"])
def test_a_view_has_the_labels_of_its_image(split: str) -> None:
    recipe = Recipe(split, level_named("hard"), 48, 3)
    hand, view = synthetic_hand(recipe, 5), synthetic_view(recipe, 5)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(view, name), getattr(hand, name), name)


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_only_test_images_have_labels_without_noise(split: str) -> None:
    recipe = Recipe(split, level_named("hard"), 224, 0)
    with_image, alone = (
        synthetic_view(recipe, 2),
        synthetic_view(replace(recipe, pictures=False), 2),
    )
    differing = {
        name
        for name in NAMES
        if not np.array_equal(getattr(with_image, name), getattr(alone, name), equal_nan=True)
    }
    assert differing == (
        {"landmarks_2d", "label_noise", "confidence"} if split == "test" else set()
    )
    assert (alone.label_noise >= 2).all()
    if split == "test":
        assert with_image.labelled.all()
        assert alone.labelled.all()  # By chance: this hand misses no landmark.
        assert (with_image.label_noise == 0).all()
        assert (with_image.confidence == 1).all()


def test_residuals_have_the_stated_noise(detected: SyntheticHands) -> None:
    """Over about 6,000 coordinates; a bias of a tenth of a pixel would be seen."""
    batch = detected.batch(list(range(SIZE)))
    assert batch.landmarks_3d is not None
    assert batch.intrinsics is not None
    assert batch.label_noise is not None
    clean = project(batch.landmarks_3d, batch.intrinsics)
    residual = ((batch.landmarks_2d - clean) / batch.label_noise[..., None])[batch.labelled]
    assert len(residual) > 2500
    assert float(residual.std()) == pytest.approx(1.0, abs=0.03)
    assert float(residual.mean()) == pytest.approx(0.0, abs=0.03)


def test_confidence_falls_with_the_noise_but_not_for_outliers(
    stored: dict[str, np.ndarray],
) -> None:
    noise, confidence = stored["label_noise"].ravel(), stored["confidence"].ravel()
    outlier = np.isclose(noise, level_named("hard").noise_outlier)
    assert 0.005 < outlier.mean() < 0.04
    ranks = [np.argsort(np.argsort(values)) for values in (noise[~outlier], confidence[~outlier])]
    centred = [rank - rank.mean() for rank in ranks]
    assert (centred[0] * centred[1]).mean() / (ranks[0].std() * ranks[1].std()) < -0.6
    # The confidence is ½ at 5 px; errors of the detector's estimate average out.
    near = confidence[np.abs(noise - 5) < 0.5]
    assert np.median(near) == pytest.approx(0.5, abs=0.06)
    assert np.median(confidence[outlier]) == pytest.approx(np.median(confidence), abs=0.15)
    assert (confidence > 0).all()
    assert (confidence < 1).all()


def test_some_landmarks_are_missing(detected: SyntheticHands) -> None:
    batch = detected.batch(list(range(SIZE)))
    assert 0.02 < float((~batch.labelled).float().mean()) < 0.08
    assert torch.equal(batch.landmarks_2d.isfinite().all(dim=-1), batch.labelled)


def test_views_lie_upright_in_the_middle_of_their_crops(detected: SyntheticHands) -> None:
    for index in range(10):
        sample = detected[index]
        known = sample.landmarks_2d[sample.labelled]
        low, high = known.amin(dim=0), known.amax(dim=0)
        assert_close((low + high) / 2, torch.full((2,), 112.0))
        assert float((high - low).max()) == pytest.approx(FILL * 224, rel=1e-4)
        wrist, knuckles = sample.landmarks_2d[0], sample.landmarks_2d[[5, 9, 13, 17]]
        if sample.labelled[[0, 5, 9, 13, 17]].all():
            assert float((knuckles.mean(dim=0) - wrist)[1]) < 0
            assert float((knuckles.mean(dim=0) - wrist)[0]) == pytest.approx(0, abs=0.01)


def test_the_ground_truth_rotates_with_its_crop(detected: SyntheticHands) -> None:
    indices = torch.arange(SIZE)
    posed = open_hand().to_camera(detected.parameters(indices))
    torch.testing.assert_close(posed.landmarks, detected.landmarks_3d, atol=2e-6, rtol=0)
    batch = detected.batch(indices.tolist())
    assert batch.vertices is not None
    torch.testing.assert_close(posed.vertices, batch.vertices, atol=2e-6, rtol=0)


def same(first: HandBatch, second: HandBatch) -> None:
    for field in fields(HandBatch):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, torch.Tensor):
            torch.testing.assert_close(a, b, equal_nan=True, atol=1e-6, rtol=1e-5)
        else:
            assert a == b, field.name


@pytest.mark.parametrize("pictures", [True, False])
@pytest.mark.parametrize("split", ["train", "val"])
def test_a_batch_is_its_samples_stacked(cache: Path, split: str, *, pictures: bool) -> None:
    dataset = SyntheticHands(split, 5, 32, "hard", cache_dir=cache, pictures=pictures)
    same(dataset.batch([3, 0, 4]), collate([dataset[3], dataset[0], dataset[4]]))


def test_there_is_no_image_on_disk_and_none_in_a_sample(detected: SyntheticHands) -> None:
    names = sorted(path.name for path in detected.folder.iterdir())
    assert names == ["labels.npz", "manifest.json"]
    assert detected.folder.name.startswith(f"synthetic_hard_test_{SIZE}_views")
    manifest = json.loads((detected.folder / "manifest.json").read_text())
    assert manifest["recipe"]["pictures"] is False
    assert detected[0].image.shape == (3, 0, 0)
    assert detected.batch([0, 1]).image.shape == (2, 3, 0, 0)
    assert detected.batch([0, 1]).crop_size == 224


def test_no_image_is_rendered(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("rendered")

    monkeypatch.setattr(image_store, "synthetic_hand", never)
    monkeypatch.setattr("hand_recon.data.synthetic.scene.render_image", never)
    assert len(hands(cache, "train", 3)) == 3


def test_views_and_images_of_one_recipe_have_different_folders(cache: Path) -> None:
    recipes = [
        Recipe("train", level_named("hard"), 224, 0, pictures=which) for which in (True, False)
    ]
    assert len({image_store.store_path(cache, recipe, 6) for recipe in recipes}) == 2


def test_loaders_ask_for_whole_batches(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = SyntheticDataModule(
        "hard", train_size=12, val_size=3, test_size=3, crop_size=224, cache_dir=cache,
        pictures=False, batch_size=4, seed=1,
    )  # fmt: skip

    def never(*_: object) -> None:
        raise AssertionError("a single sample")

    monkeypatch.setattr(SyntheticHands, "__getitem__", never)
    batches = list(data.train_dataloader())
    assert data.name == "views"
    assert [len(batch) for batch in batches] == [4, 4, 4]
    assert torch.cat([batch.index for batch in batches]).sort().values.tolist() == list(range(12))
    ground_truth = data.train_ground_truth(5)
    assert ground_truth is not None
    assert ground_truth[0].shape == (5, 21, 3)
    assert ground_truth[1] is not None
