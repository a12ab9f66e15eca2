"""Crops of photographs are those that training reads, to the pixel."""

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from hand_recon.data.annotated_dataset import AnnotatedImages, ImageRecipe
from hand_recon.data.crop import CropPolicy
from hand_recon.data.crop_reader import ReadingPolicy
from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from hand_recon.data.photos.photo import read_photo
from hand_recon.detection.detector import DetectedHand
from hand_recon.runs.landmark_lookup import FileLandmarks
from hand_recon.runs.photo_crops import crop_policy, frame_of, sample_of
from hand_recon.schema import HandSample
from tests.support.annotated_images import annotated
from tests.support.configurations import composed
from tests.support.dotted_images import Dotted
from tests.support.photos import exif_of

EXAMPLES = Path(__file__).parents[2] / "examples"


SEEN = ("image", "landmarks_2d", "labelled", "intrinsics", "confidence")
"""Parts of a sample that a network can see."""


def assert_same(found: HandSample, read: HandSample) -> None:
    for name in SEEN:
        ours, theirs = getattr(found, name), getattr(read, name)
        assert (ours is None) == (theirs is None), name
        if theirs is not None:
            assert torch.equal(ours.nan_to_num(-1.0), theirs.nan_to_num(-1.0)), name
    assert found.mirrored == read.mirrored


def training_samples(file: Path, policy: CropPolicy, images: Path | None = None) -> AnnotatedImages:
    """The samples that training reads of a file of landmarks."""
    recipe = LandmarkRecipe(
        file, images=images, crop=policy, reading=ReadingPolicy(None), min_side=1
    )
    return LandmarkSplits(replace(recipe, test=file)).dataset("test")


def detected(file: Path, image: Path) -> list[DetectedHand]:
    """The hands that `detector=landmarks` finds in an image."""
    return list(
        FileLandmarks(file, read_landmarks(file))(np.zeros((1, 1, 3), np.uint8), image).hands
    )


def ours(file: Path, image: Path, policy: CropPolicy) -> list[HandSample]:
    pixels = read_photo(image).pixels
    return [
        sample_of(pixels, hand, frame_of(hand, policy.around), policy)[0]
        for hand in detected(file, image)
    ]


@pytest.mark.parametrize(("size", "expansion"), [(64, 1.5), (48, 1.2), (224, 2.5), (9, 1.0)])
def test_crops_of_left_and_right_hands_are_those_of_training(
    tmp_path: Path, size: int, expansion: float
) -> None:
    """Larger and smaller crops than the hand, which reach out of the image."""
    dotted = Dotted(tmp_path / "images")
    file = dotted.write(dotted.objects())
    policy = CropPolicy(size, "joints", expansion)
    samples = training_samples(file, policy)
    assert len(samples) == 6
    found = [
        one
        for image in range(3)
        for one in ours(file, tmp_path / "images" / f"image{image}.png", policy)
    ]
    assert [one.mirrored for one in found] == [True, False] * 3
    for place, one in enumerate(found):
        assert_same(one, samples[place])
    # Left hands are red and right ones green: crops show the hands that they should.
    assert int(found[0].image[0].sum()) > 0
    assert not torch.equal(found[0].image, found[1].image)


@pytest.mark.parametrize("around", ["joints", "box"])
@pytest.mark.parametrize("labelled", [21, 9])
def test_boxes_of_a_file_count_as_in_training(tmp_path: Path, around: str, labelled: int) -> None:
    """With few landmarks, the box of the file is joined to that of the landmarks (decision 41)."""
    dotted = Dotted(tmp_path / "images", images=1)
    file = dotted.as_coco()
    content = json.loads(file.read_text())
    for hand in content["annotations"]:
        left, top, width, height = hand["bbox"]
        hand["bbox"] = [left - 8, top - 3, width + 14, height + 6]
        hand["keypoints"][3 * labelled :] = [0] * 3 * (21 - labelled)
    file.write_text(json.dumps(content))
    policy = CropPolicy(40, around)
    samples = training_samples(file, policy)
    found = ours(file, tmp_path / "images" / "image0.png", policy)
    assert len(found) == len(samples) == 2
    for place, one in enumerate(found):
        assert_same(one, samples[place])


def test_cameras_of_mirrored_crops_are_those_of_training(tmp_path: Path) -> None:
    table = annotated(tmp_path)
    samples = AnnotatedImages(
        table, recipe=ImageRecipe(CropPolicy(32, "joints"), ReadingPolicy(None))
    )
    assert table.left is not None
    assert table.intrinsics is not None
    for row in range(len(table)):
        hand = DetectedHand(
            table.landmarks_2d[row], "left" if table.left[row] else "right", None, 1.0
        )
        pixels = read_photo(table.images[row]).pixels
        found, _ = sample_of(
            pixels, hand, frame_of(hand, "joints"), CropPolicy(32), table.intrinsics[row]
        )
        assert_same(found, samples[row])


def test_a_photograph_in_jpeg_gives_the_pixels_of_training(tmp_path: Path) -> None:
    """Training decodes with OpenCV, `predict` with Pillow; without a colour profile both agree."""
    points = np.random.default_rng(1).uniform((200, 60), (420, 330), (21, 2))
    entry = {"image": "two_hands.jpg", "side": "left", "landmarks": points.tolist()}
    file = tmp_path / "labels.json"
    file.write_text(json.dumps([entry]))
    samples = training_samples(file, CropPolicy(64, "joints"), EXAMPLES)
    hand = DetectedHand(points, "left", None, 1.0)
    found, matrix = sample_of(
        read_photo(EXAMPLES / "two_hands.jpg").pixels,
        hand,
        frame_of(hand, "joints"),
        CropPolicy(64),
    )
    assert_same(found, samples[0])
    assert np.linalg.det(matrix[:2, :2]) < 0


def test_the_square_is_one_and_a_half_boxes_about_its_middle() -> None:
    """A box of 40 × 20 about (60, 40): a square of 60 px from (30, 10); one pixel is two of the crop."""
    pixels = np.zeros((100, 120, 3), np.uint8)
    pixels[10, 30] = 255
    hand = DetectedHand(np.full((21, 2), np.nan), "right", None, 1.0)
    sample, matrix = sample_of(pixels, hand, np.array([40.0, 30.0, 80.0, 50.0]), CropPolicy(120))
    np.testing.assert_allclose(matrix, [[2, 0, -60], [0, 2, -20], [0, 0, 1]])
    assert int(sample.image[0, :2, :2].min()) > 100
    assert not sample.labelled.any()
    mirrored, _ = sample_of(
        pixels, replace(hand, side="left"), np.array([40.0, 30.0, 80.0, 50.0]), CropPolicy(120)
    )
    assert torch.equal(mirrored.image, sample.image.flip(-1))


@pytest.mark.parametrize(
    ("words", "size", "around", "expansion"),
    [
        (["data=landmarks", "data.train=x.json", "crop_size=136"], 136, "joints", 1.5),
        (["data=landmarks", "data.train=x.json", "data.crop.around=box", "data.crop.expansion=1.3"],
         64, "box", 1.3),
        (["data=dexycb", "data.root=x", "data.crop.expansion=1.4"], 64, "joints", 1.4),
        (["data=freihand", "data.root=x", "data.crop.around=mask"], 64, "joints", 1.5),
        (["data=mixture", "data.parts.freihand.root=x", "data.parts.landmarks.train=x.json",
          "data.parts.landmarks.crop.expansion=1.7"], 64, "joints", 1.7),
        (["data=mixture", "data.parts.freihand.root=x", "data.parts.landmarks.train=x.json",
          "data.parts.freihand.crop.around=joints", "data.parts.freihand.crop.expansion=1.1"],
         64, "joints", 1.1),
        (["crop_size=80"], 80, "joints", 1.5),
    ],
)  # fmt: skip
def test_crops_follow_the_configuration_of_the_training(
    words: list[str], size: int, around: str, expansion: float, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        found = crop_policy(composed(*words))
    assert (found.size, found.around, found.expansion) == (size, around, expansion)
    assert not caplog.text


def test_a_training_on_whole_images_is_noted(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        found = crop_policy(composed("data=freihand", "data.root=x", "crop_size=96"))
    assert (found.size, found.around, found.expansion) == (96, "joints", 1.5)
    assert "trained on crops around=full" in caplog.text


def test_an_image_that_is_rotated_by_exif_is_cut_as_training_cuts_it(tmp_path: Path) -> None:
    random = np.random.default_rng(2).integers(0, 255, (8, 12, 3)).astype(np.uint8)
    stored = cv2.resize(random, (120, 80), interpolation=cv2.INTER_NEAREST)
    Image.fromarray(stored).save(tmp_path / "a.jpg", exif=exif_of(Orientation=6), quality=95)
    points = np.random.default_rng(3).uniform((10, 20), (70, 100), (21, 2))
    entry: dict[str, Any] = {"image": "a.jpg", "side": "right", "landmarks": points.tolist()}
    (tmp_path / "labels.json").write_text(json.dumps([entry]))
    policy = CropPolicy(50, "joints")
    samples = training_samples(tmp_path / "labels.json", policy)
    hand = DetectedHand(points, "right", None, 1.0)
    found, _ = sample_of(
        read_photo(tmp_path / "a.jpg").pixels, hand, frame_of(hand, "joints"), policy
    )
    assert_same(found, samples[0])
