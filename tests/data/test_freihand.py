import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.data.crop import CropPolicy
from hand_recon.data.freihand.dataset import FreiHand
from hand_recon.data.freihand.splits import FreiHandRecipe
from hand_recon.hand.mano.hand import TIP_VERTICES
from tests.support.freihand_folder import (
    SIZE,
    Folder,
    edit_json,
    image_number,
    write_folder,
    write_json,
)

FULL = CropPolicy(size=SIZE)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return write_folder(tmp_path / "FreiHAND_pub_v2")


def test_labels_are_the_projections_of_the_landmarks(folder: Folder) -> None:
    data = FreiHand("train", FreiHandRecipe(folder.root, FULL))
    for index in (0, 7, len(data) - 1):
        sample = data[index]
        hand = image_number(sample.source) % 20
        np.testing.assert_allclose(sample.landmarks_2d, folder.pixels()[hand], atol=1e-3)
        assert sample.landmarks_3d is not None
        np.testing.assert_allclose(sample.landmarks_3d, folder.landmarks[hand], atol=1e-6)
        assert sample.labelled.all()
        assert sample.index == index


@pytest.mark.parametrize("crop", [CropPolicy(96), CropPolicy(96, "joints", 1.3)])
def test_dots_in_the_image_are_where_the_labels_are(folder: Folder, crop: CropPolicy) -> None:
    data = FreiHand("val", FreiHandRecipe(folder.root, crop))
    sample = data[0]
    columns, rows = sample.landmarks_2d.int().T
    inside = (columns >= 0) & (columns < 96) & (rows >= 0) & (rows < 96)
    assert inside.sum() > 15
    assert sample.image[1, rows[inside], columns[inside]].float().mean() > 180
    assert sample.image[1].float().mean() < 120


def test_a_crop_around_joints_holds_them_all(folder: Folder) -> None:
    data = FreiHand("train", FreiHandRecipe(folder.root, CropPolicy(96, "joints", 1.5)))
    labels = torch.stack([data[index].landmarks_2d for index in range(len(data))])
    assert labels.min() > 96 / 6 - 1e-3
    assert labels.max() < 96 * 5 / 6 + 1e-3


def test_image_i_plus_n_v_is_version_v_of_hand_i(folder: Folder) -> None:
    data = FreiHand("train", FreiHandRecipe(folder.root, FULL, versions=("hom", "auto")))
    for sample in (data[index] for index in range(len(data))):
        number = image_number(sample.source)
        assert number // 20 in (1, 3)
        # The writer painted 40 + 40 v into the background's red.
        assert abs(float(sample.image[0].median()) - 40 - 40 * (number // 20)) < 8


def test_no_hand_is_in_two_splits_and_none_is_lost(folder: Folder) -> None:
    recipe = FreiHandRecipe(folder.root, FULL, split_seed=3)
    hands = {}
    for split in ("train", "val", "test"):
        data = FreiHand(split, recipe)
        hands[split] = {image_number(data[index].source) % 20 for index in range(len(data))}
    assert hands["train"] | hands["val"] | hands["test"] == set(range(20))
    assert sum(map(len, hands.values())) == 20
    assert len(hands["val"]) == len(hands["test"]) == 2


def test_training_sees_four_colourings_and_validation_one(folder: Folder) -> None:
    recipe = FreiHandRecipe(folder.root, FULL)
    assert len(FreiHand("train", recipe)) == 16 * 4
    assert len(FreiHand("val", recipe)) == 2


def test_a_root_with_green_screen_images_only_is_enough(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "own", versions=1).root
    (root / "training_scale.json").unlink()
    assert len(FreiHand("train", FreiHandRecipe(root, FULL))) == 16


@pytest.mark.parametrize("name", ["FreiHAND_pub_v2_eval", "FreiHAND_pub_v2"])
def test_the_evaluation_part_is_found_beside_or_inside(folder: Folder, name: str) -> None:
    evaluation = write_folder(folder.root.parent / name, 7, 1, "evaluation", seed=9)
    data = FreiHand("test", FreiHandRecipe(folder.root, FULL))
    assert [data[index].index for index in range(7)] == list(range(7))
    ground_truth = data[4].landmarks_3d
    assert ground_truth is not None
    np.testing.assert_allclose(ground_truth, evaluation.landmarks[4], atol=1e-6)
    # With a real test set, the hands that would have been held out train.
    assert len(FreiHand("train", FreiHandRecipe(folder.root, FULL))) == 18 * 4


def test_testing_on_held_out_hands_is_said_aloud(
    folder: Folder, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        FreiHand("test", FreiHandRecipe(folder.root, FULL))
    assert "testing on 2 held-out hands" in caplog.text


def test_asking_for_a_missing_evaluation_names_the_cure(folder: Folder) -> None:
    with pytest.raises(FileNotFoundError, match=r"FreiHAND_pub_v2_eval.zip: unpack that"):
        FreiHand("test", FreiHandRecipe(folder.root, FULL, test_source="evaluation"))


@pytest.mark.parametrize("name", ["training_xyz.json", "training_K.json"])
def test_a_missing_file_is_named(folder: Folder, name: str) -> None:
    (folder.root / name).unlink()
    with pytest.raises(FileNotFoundError, match=rf"No {name} in .*FreiHAND_pub_v2.zip"):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


def test_a_missing_root_names_the_cure(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No folder .*nowhere.*or run data=synthetic"):
        FreiHand("train", FreiHandRecipe(tmp_path / "nowhere", FULL))


def test_the_folder_above_the_root_points_to_the_root(folder: Folder) -> None:
    with pytest.raises(FileNotFoundError, match=r"set data.root=.*FreiHAND_pub_v2\."):
        FreiHand("train", FreiHandRecipe(folder.root.parent, FULL))


def test_a_wrong_number_of_images_says_found_and_expected(folder: Folder) -> None:
    (folder.root / "training" / "rgb" / "00000079.jpg").unlink()
    with pytest.raises(ValueError, match=r"79 images.*annotates 20 hands.*80 in a full set"):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


def test_a_gap_in_the_images_is_named(folder: Folder) -> None:
    (folder.root / "training" / "rgb" / "00000013.jpg").unlink()
    with pytest.raises(FileNotFoundError, match=r"00000013.jpg is missing"):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


def test_a_missing_version_is_named(tmp_path: Path) -> None:
    root = write_folder(tmp_path / "own", versions=2).root
    with pytest.raises(ValueError, match=r"no version \['auto'\]; it has \['gs', 'hom'\]"):
        FreiHand("train", FreiHandRecipe(root, FULL, versions=("gs", "auto")))


def test_lists_of_unequal_length_are_refused(folder: Folder) -> None:
    write_json(folder.root / "training_K.json", folder.intrinsics[:19])
    with pytest.raises(
        ValueError,
        match=r"training_K.json holds an array of 19 × 3 × 3, expected 20.*of training_xyz\.json\)",
    ):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


def test_a_json_file_that_was_cut_off_is_refused(folder: Folder) -> None:
    path = folder.root / "training_xyz.json"
    path.write_text(path.read_text()[:-100])
    with pytest.raises(ValueError, match=r"training_xyz.json is not a complete JSON list"):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("xyz", lambda a: a[0].fill(np.nan), r"1 of 20 hands have .* not finite"),
        ("xyz", lambda a: np.negative(a, out=a), "20 of 20 hands have landmarks at z ≤ 0"),
        ("xyz", lambda a: np.multiply(a, 1000, out=a), r"is 30 long .* must be metres"),
        ("scale", lambda a: np.multiply(a, 2, out=a), "20 of 20 hands have lengths that differ"),
        ("K", lambda a: a[4].fill(0), r"1 of 20 hands have matrices that are not .* first are 4"),
        ("K", lambda a: np.multiply(a, [[10], [10], [1]], out=a), "20 of 20 hands project far"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_hand_before_a_camera_is_refused(
    folder: Folder, name: str, change: Callable[[np.ndarray], object], message: str
) -> None:
    edit_json(folder.root / f"training_{name}.json", change)
    with pytest.raises(ValueError, match=message):
        FreiHand("train", FreiHandRecipe(folder.root, FULL))


def test_one_odd_scale_in_many_is_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    root = write_folder(tmp_path / "many", hands=101, versions=1).root
    edit_json(root / "training_scale.json", lambda a: np.put(a, [17], 9.0))
    FreiHand("train", FreiHandRecipe(root, FULL))
    assert "entry 17 is not the length" in caplog.text


def write_vertices(folder: Folder, count: int, mano: bool = False) -> np.ndarray:
    vertices = np.random.default_rng(1).normal(0, 0.05, (20, count, 3))
    if mano:
        vertices[:, list(TIP_VERTICES["freihand"])] = folder.landmarks[:, 4::4]
    write_json(folder.root / "training_verts.json", vertices)
    return vertices


def test_vertices_are_given_for_evaluation_and_not_for_training(folder: Folder) -> None:
    vertices = write_vertices(folder, 778)
    recipe = FreiHandRecipe(folder.root, FULL)
    sample = FreiHand("test", recipe)[0]
    assert sample.vertices is not None
    np.testing.assert_allclose(sample.vertices, vertices[image_number(sample.source)], atol=1e-6)
    for split in ("train", "val"):
        assert FreiHand(split, recipe)[0].vertices is None
    assert FreiHand("train", recipe, with_vertices=True)[0].vertices is not None


@pytest.mark.parametrize(
    ("count", "mano", "message"),
    [
        (None, False, "No training_verts.json"),
        (500, False, "surfaces of 500 vertices, the hand model 778"),
        (778, True, "MANO's surfaces, which cannot be compared"),
    ],
)
def test_vertices_that_cannot_be_compared_are_left_out_aloud(
    folder: Folder, caplog: pytest.LogCaptureFixture, count: int | None, mano: bool, message: str
) -> None:
    if count is not None:
        write_vertices(folder, count, mano)
    assert FreiHand("test", FreiHandRecipe(folder.root, FULL))[0].vertices is None
    assert message in caplog.text


def test_mano_surfaces_are_for_the_mano_hand(folder: Folder) -> None:
    vertices = write_vertices(folder, 778, mano=True)
    sample = FreiHand("test", FreiHandRecipe(folder.root, FULL, topology="mano"))[0]
    assert sample.vertices is not None
    np.testing.assert_allclose(sample.vertices, vertices[image_number(sample.source)], atol=1e-6)


def test_a_choice_that_does_not_exist_is_refused(folder: Folder) -> None:
    with pytest.raises(ValueError, match="Unknown split 'training'"):
        FreiHand("training", FreiHandRecipe(folder.root))
    with pytest.raises(ValueError, match="Unknown test_source 'val'"):
        FreiHandRecipe(folder.root, test_source="val")
    with pytest.raises(ValueError, match=r"val_fraction=0.7 must lie between"):
        FreiHandRecipe(folder.root, val_fraction=0.7)
