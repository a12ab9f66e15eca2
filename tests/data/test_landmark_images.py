"""Images with 2D landmarks only as training data: the crops, and the hands that are left out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.annotated_dataset import AnnotatedImages
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_files import hand_frames
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from hand_recon.hand.skeleton import LANDMARK_ORDERS, LANDMARKS
from hand_recon.schema import collate
from tests.support.dotted_images import FORMS, Dotted

SIZE = 96


def everything(path: Path, **recipe: Any) -> AnnotatedImages:  # noqa: ANN401
    """All hands of a file, read as validation data so that none is held out."""
    recipe = {"crop": CropPolicy(SIZE, "joints")} | recipe
    return LandmarkSplits(LandmarkRecipe(path, path, path, **recipe)).dataset("val")


@pytest.mark.parametrize("form", list(FORMS))
def test_every_form_gives_the_same_crops_with_a_dot_at_each_label(
    tmp_path: Path, form: str
) -> None:
    dotted = Dotted(tmp_path)
    data = everything(FORMS[form](dotted))
    assert len(data) == 6
    for index in range(6):
        sample = data[index]
        left = dotted.sides[index] == "left"
        assert sample.mirrored == left
        assert sample.intrinsics is None
        assert sample.landmarks_3d is None
        # The box is 70 wide and 60 high, the square 1.5 times 70: its middle is the crop's.
        scale = SIZE / 105
        middle = (dotted.points[index].min(axis=0) + dotted.points[index].max(axis=0)) / 2
        expected = (dotted.points[index] - middle) * scale * [-1 if left else 1, 1] + SIZE / 2
        np.testing.assert_allclose(sample.landmarks_2d.numpy(), expected, atol=1e-4)
        columns, rows = sample.landmarks_2d.int().T
        assert (sample.image[0 if left else 1, rows, columns] > 80).all()


def test_missing_joints_are_masked_and_hidden_ones_are_labels_still(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    keypoints = np.array(dotted.keypoints(1)).reshape(21, 3)
    keypoints[3] = 0
    keypoints[5, 2] = 1
    entry = {"image_id": "image0.png", "keypoints": keypoints.ravel().tolist(), "side": "right"}
    sample = everything(dotted.write([entry]))[0]
    assert sample.labelled.tolist() == [number != 3 for number in range(21)]
    assert sample.landmarks_2d.isnan().all(dim=1).tolist() == [number == 3 for number in range(21)]
    assert sample.occluded is not None
    assert sample.occluded.nonzero().tolist() == [[5]]


def test_tiny_hands_and_those_of_few_landmarks_are_left_out_aloud(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    dotted = Dotted(tmp_path)
    hands = dotted.objects()
    # 70 × 0.3 = 21 pixels; three landmarks; and one that is just large enough.
    hands[0]["landmarks"] = (dotted.points[0] * 0.3).tolist()
    hands[1]["landmarks"] = [*dotted.points[1, :3].tolist(), *[None] * 18]
    hands[2]["landmarks"] = (dotted.points[2] * 0.35).tolist()
    data = everything(dotted.write(hands))
    assert "2 of 6 hands are left out: 1 have fewer than 4 labelled landmarks" in caplog.text
    assert "1 are smaller than min_side=24 pixels" in caplog.text
    assert [data[index].source for index in range(4)] == [
        "image1.png", "image1.png", "image2.png", "image2.png",
    ]  # fmt: skip
    assert len(everything(dotted.root / "landmarks.json", min_side=0)) == 5
    with pytest.raises(ValueError, match="none of 6 hands can be trained on"):
        everything(dotted.root / "landmarks.json", min_side=500)


def test_the_box_of_few_labels_is_joined_to_the_datasets(tmp_path: Path) -> None:
    """Five labels of a finger from (50, 20) to (60, 40), in a hand's box from (30, 10) to (58, 90)."""
    finger = [[50.0, 20.0], [52.0, 25.0], [55.0, 30.0], [58.0, 35.0], [60.0, 40.0]]
    few: list[Any] = [*finger, *[None] * 16]
    whole = [*finger, *[[55.0, 30.0]] * 11, *[None] * 5]
    box = [30, 10, 58, 90]
    hands: list[dict[str, Any]] = [
        {"landmarks": few, "box": box}, {"landmarks": whole, "box": box}, {"landmarks": few},
    ]  # fmt: skip
    landmarks = read_landmarks(Dotted(tmp_path).write(hands))
    labels = [50, 20, 60, 40]
    assert hand_frames(landmarks, "joints").tolist() == [[30, 10, 60, 90], labels, labels]
    assert hand_frames(landmarks, "box").tolist() == [box, box, labels]
    assert hand_frames(landmarks.select(slice(2, 3)), "box").tolist() == [labels]


def test_sigma_is_scaled_with_the_crop_and_confidence_is_not(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    hands = dotted.objects()
    # The first hand is a left one: a mirror makes no negative σ.
    hands[0] |= {"sigma": [2.0] * 20 + [None], "confidence": [0.5] * 21}
    data = everything(dotted.write(hands))
    noise, confidence = data[0].label_noise, data[0].confidence
    assert noise is not None
    assert confidence is not None
    torch.testing.assert_close(noise[:20], torch.full((20,), 2.0 * SIZE / 105))
    assert noise[20].isnan()
    assert (confidence == 0.5).all()
    assert data[1].label_noise is None
    batch = collate([data[0], data[1]])
    assert batch.label_noise is not None
    assert batch.label_noise[1].isnan().all()


def test_landmarks_in_another_order_are_put_right(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    expected = everything(dotted.as_json())[1].landmarks_2d
    order = [LANDMARKS.index(name) for name in LANDMARK_ORDERS["rhd"]]
    dotted.points = dotted.points[:, order]
    shuffled = everything(dotted.as_coco(), order="rhd")[1].landmarks_2d
    torch.testing.assert_close(shuffled, expected)


def test_a_side_that_no_file_tells_has_to_be_given(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    hands = [{key: hand[key] for key in ("landmarks", "image")} for hand in dotted.objects()]
    path = dotted.write(hands)
    with pytest.raises(ValueError, match=r"gives no side for 6 of 6 hands"):
        everything(path)
    assert everything(path, side="left")[0].mirrored
    assert not everything(path, side="right")[0].mirrored


def test_missing_images_count_like_damaged_ones(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    dotted = Dotted(tmp_path)
    path = dotted.as_json()
    (tmp_path / "image0.png").unlink()
    for reading in (ReadingPolicy(max_corrupt=1), ReadingPolicy(tmp_path / "cache", max_corrupt=1)):
        caplog.clear()
        data = everything(path, reading=reading)
        # The next hand whose image can be read.
        assert data[0].index == 2
        assert "1 of 3 images are not there" in caplog.text
    with pytest.raises(RuntimeError, match="1 images cannot be read, more than max_corrupt=0"):
        everything(path, reading=ReadingPolicy(max_corrupt=0))[0]
    with pytest.raises(FileNotFoundError, match=r"None of 3 images is there.*data\.images"):
        everything(path, images=tmp_path / "elsewhere")


def test_images_may_lie_elsewhere_and_must_be_named(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path / "pictures")
    path = dotted.as_json().rename(tmp_path / "landmarks.json")
    assert everything(path, images=dotted.root)[0].source == "image0.png"
    nameless = dotted.write([{"landmarks": dotted.points[0].tolist(), "side": "left"}])
    with pytest.raises(ValueError, match="1 of 1 hands name no image"):
        everything(nameless)


def test_landmarks_of_larger_images_are_refused(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    dotted.points *= 4
    with pytest.raises(ValueError, match="6 of 6 hands that were checked lie outside"):
        everything(dotted.as_json())


def test_other_labels_boxes_or_images_make_another_cache(tmp_path: Path) -> None:
    dotted = Dotted(tmp_path)
    reading = ReadingPolicy(tmp_path / "cache")
    prints = {everything(dotted.as_json(), reading=reading).hands.fingerprint}
    assert everything(dotted.as_json()).hands.fingerprint in prints
    dotted.points[0, 3] += 1
    prints.add(everything(dotted.as_json()).hands.fingerprint)
    Dotted(tmp_path)
    prints.add(everything(dotted.as_json()).hands.fingerprint)
    assert len(prints) == 3
    assert len(list((tmp_path / "cache").rglob("crops.npy"))) == 1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_all_hands_of_an_image_are_in_one_split(
    tmp_path: Path, seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    path = Dotted(tmp_path, images=12).as_coco()
    recipe = LandmarkRecipe(path, val_fraction=0.25, split_seed=seed, crop=CropPolicy(16, "joints"))
    splits = LandmarkSplits(recipe)
    found = {}
    for split in ("train", "val", "test"):
        data = splits.dataset(split)
        found[split] = [data.hands.source(int(row)) for row in data.rows]
    assert {split: len(sources) for split, sources in found.items()} == {
        "train": 12, "val": 6, "test": 6,
    }  # fmt: skip
    images = [set(sources) for sources in found.values()]
    assert sum(map(len, images)) == len(set.union(*images)) == 12
    assert "testing on 6 held-out hands" in caplog.text
    again = LandmarkSplits(recipe).dataset("val")
    assert [again.hands.source(int(row)) for row in again.rows] == found["val"]


def test_some_of_the_training_images_are_drawn(tmp_path: Path) -> None:
    path = Dotted(tmp_path, images=12).as_coco()
    crop = CropPolicy(16, "joints")

    def images(split: str, count: int | None) -> set[str]:
        recipe = LandmarkRecipe(path, val_fraction=0.25, train_size=count, crop=crop)
        data = LandmarkSplits(recipe).dataset(split)
        return {data.hands.source(int(row)) for row in data.rows}

    every, four, two = (images("train", count) for count in (None, 4, 2))
    assert (len(every), len(four), len(two)) == (6, 4, 2)
    # Nested, so that a study of fewer labels compares like with like; what is held out stays.
    assert two < four < every
    assert images("val", 2) == images("val", None)
    with pytest.raises(ValueError, match=r"train_size=7, and .* has 6 images to train on"):
        images("train", 7)
    with pytest.raises(ValueError, match=r"train_size=0; expected the number"):
        images("train", 0)


def test_images_that_are_in_two_files_are_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = Dotted(tmp_path).as_json()
    splits = LandmarkSplits(LandmarkRecipe(path, path, path, crop=CropPolicy(16, "joints")))
    assert len(splits.dataset("train")) == 6
    assert not caplog.text
    splits.dataset("val")
    assert "3 of the val images are training images too" in caplog.text


def test_a_recipe_that_cannot_be_followed_is_refused(tmp_path: Path) -> None:
    path = Dotted(tmp_path, images=2).as_json()
    with pytest.raises(ValueError, match=r"has 2 images, too few .* for val and test"):
        LandmarkSplits(LandmarkRecipe(path)).dataset("train")
    with pytest.raises(ValueError, match="Crops around 'mask' need what landmark files do not"):
        LandmarkRecipe(path, crop=CropPolicy(around="mask"))
    with pytest.raises(ValueError, match=r"val_fraction=0\.5 must lie between"):
        LandmarkRecipe(path, val_fraction=0.5)
    with pytest.raises(ValueError, match="Unknown landmark order 'mine'"):
        LandmarkRecipe(path, order="mine")
