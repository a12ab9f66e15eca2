"""`prepare labels` on folders as people have them, with a made-up detector of bright dots."""

import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from omegaconf import DictConfig, open_dict
from PIL import Image

from hand_recon.data.dataset import load_batch
from hand_recon.data.photos.photo import read_photo
from hand_recon.detection.detector import DetectedHand, Detections
from hand_recon.runs import preparation as prepare
from hand_recon.runs.building import build_data
from hand_recon.runs.labelling import labeller
from tests.support.configurations import composed

SIZE = (120, 90)
"""Width and height of the images as stored, pixels."""


class Dots:
    """A detector that takes 21 dots, told apart by their grey values, for the landmarks of a left hand."""

    name = "dots"

    def __call__(self, image: np.ndarray, file: Path | None = None) -> Detections:
        assert file is not None
        if file.stem == "refused":
            raise ValueError("two entries name this image")
        points = np.array(
            [np.argwhere(image[..., 0] == 50 + 9 * number).mean(axis=0) for number in range(21)]
        )
        score = 0.5 if file.stem == "poor" else 0.95
        return Detections((DetectedHand(points[:, ::-1] + 0.5, "left", score, 0.9),))


def dotted(seed: int) -> np.ndarray:
    """An image with 21 dots of 3 × 3 pixels at random places, none over another."""
    rng = np.random.default_rng(seed)
    pixels = np.zeros((SIZE[1], SIZE[0]), dtype=np.uint8)
    cells = rng.permutation([(x, y) for x in range(6, 114, 9) for y in range(6, 84, 9)])[:21]
    for number, (x, y) in enumerate(cells.tolist()):
        pixels[y - 1 : y + 2, x - 1 : x + 2] = 50 + 9 * number
    return np.repeat(pixels[..., None], 3, axis=2)


@pytest.fixture(autouse=True)
def _dots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(labeller, "build_detector", lambda config: Dots())


def asked(folder: Path, *overrides: str) -> DictConfig:
    config = composed(
        f"images='{folder}/photos'", f"output='{folder}/out'", "fit=false", "sheets=0", *overrides,
        name="prepare_labels",
    )  # fmt: skip
    with open_dict(config):
        del config["hydra"]
    return config


def drawn(path: Path, seed: int, orientation: int | None = None) -> None:
    """Write an image without loss, with EXIF's orientation if one is given."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(dotted(seed))
    exif = Image.Exif()
    if orientation is not None:
        exif[0x0112] = orientation
    image.save(path, exif=exif)


def labels(folder: Path, name: str = "labels.json") -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out" / name).read_text(encoding="utf-8"))
    return found


def test_images_of_one_name_in_several_folders_keep_their_own_labels(tmp_path: Path) -> None:
    for number, name in enumerate(("1.png", "a/1.png", "a/b/1.png", "c d/1.png")):
        drawn(tmp_path / "photos" / name, number)
    prepare.prepare(asked(tmp_path))
    hands = labels(tmp_path)["hands"]
    assert [hand["image"] for hand in hands] == ["1.png", "a/1.png", "a/b/1.png", "c d/1.png"]
    for hand in hands:
        assert_dots(read_photo(tmp_path / "photos" / hand["image"]).pixels, hand["landmarks"])


def assert_dots(pixels: np.ndarray, landmarks: Any) -> None:  # noqa: ANN401  # rows of numbers
    """The pixel at each landmark has the grey value of its dot, of which interpolation leaves the middle."""
    places = np.floor(np.asarray(landmarks)).astype(int)
    values = pixels[places[:, 1], places[:, 0], 0].astype(int)
    np.testing.assert_allclose(values, 50 + 9 * np.arange(21), atol=4)


@pytest.mark.parametrize("orientation", [None, 1, 3, 6, 8])
def test_crops_of_rotated_photographs_have_their_landmarks_on_the_dots(
    tmp_path: Path, orientation: int | None
) -> None:
    """Three images, because some are held out."""
    for number in range(3):
        drawn(tmp_path / "photos" / f"{number}.png", number, orientation)
    folder = tmp_path / "photos"
    if read_by_opencv(folder / "0.png") != read_photo(folder / "0.png").size:
        pytest.skip("this OpenCV does not apply the orientation of PNG files")
    prepare.prepare(asked(tmp_path))
    found = labels(tmp_path)
    size = SIZE if orientation in (None, 1, 3) else SIZE[::-1]
    assert {(hand["width"], hand["height"]) for hand in found["hands"]} == {size}
    file = f"'{tmp_path}/out/labels.json'"
    config = composed(
        "task=check", "data=landmarks", f"data.images='{folder}'", "crop_size=448",
        *(f"data.{split}={file}" for split in ("train", "val", "test")), name="prepare",
    )  # fmt: skip
    with open_dict(config):
        config.paths = {"cache": f"{tmp_path}/cache", "output": "", "run": ""}
        del config["hydra"]
    batch = load_batch(build_data(config).dataset("train"), [0, 1, 2])
    assert batch.mirrored is not None
    assert batch.mirrored.all()
    for hand in range(3):
        crop = batch.image[hand].permute(1, 2, 0).numpy()
        assert_dots(crop, batch.landmarks_2d[hand].numpy())


def read_by_opencv(path: Path) -> tuple[int, int]:
    pixels = cv2.imread(str(path))
    assert pixels is not None
    return pixels.shape[1], pixels.shape[0]


def test_a_name_that_is_not_utf8_and_an_image_that_the_detector_refuses_are_named(
    tmp_path: Path,
) -> None:
    drawn(tmp_path / "photos" / "good.png", 0)
    drawn(tmp_path / "photos" / "refused.png", 1)
    odd = tmp_path / "photos" / os.fsdecode(b"h\xff.png")
    try:
        odd.write_bytes((tmp_path / "photos" / "good.png").read_bytes())
    except OSError:
        pytest.skip("a file system that refuses the name")
    summary = prepare.prepare(asked(tmp_path))
    assert sorted(summary["damaged"]) == ["h\\xff.png", "refused.png"]
    assert summary["kept"] == 1


def test_a_poor_hand_is_set_aside_and_can_be_used_all_the_same(tmp_path: Path) -> None:
    drawn(tmp_path / "photos" / "good.png", 0)
    drawn(tmp_path / "photos" / "poor.png", 1)
    assert prepare.prepare(asked(tmp_path))["marks"] == {"low score": 1}
    assert [hand["image"] for hand in labels(tmp_path)["hands"]] == ["good.png"]
    doubtful = labels(tmp_path, "doubtful.json")
    assert [hand["image"] for hand in doubtful["hands"]] == ["poor.png"]
    assert doubtful["scores"] == [0.5]
    assert "0.50, expected 0.9 or more" in doubtful["marks"][0]["low score"]
    lower = asked(tmp_path, "limits.min_score=0.4", f"output='{tmp_path}/lower'")
    assert prepare.prepare(lower)["doubtful"] == 0
