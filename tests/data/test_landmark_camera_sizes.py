"""Camera matrices and the image's size: shares of it, enlarged images, and cameras of other images."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hand_recon.data.landmarks.files import read_landmarks
from tests.support.camera_files import MATRIX, POINTS, given_camera
from tests.support.landmark_writing import written

# --- size of the image --------------------------------------------------------------------------

SHARES = [[1.25, 0.0, 0.515625], [0.0, 1.6875, 235 / 480], [0.0, 0.0, 1.0]]
"""The matrix divided by 640 × 480."""


@pytest.mark.parametrize("source", ["camera", "image"])
def test_a_matrix_divided_by_the_image_size_is_multiplied_by_it(
    tmp_path: Path, source: str, caplog: pytest.LogCaptureFixture
) -> None:
    Image.new("RGB", (640, 480)).save(tmp_path / "a.png")
    extra = {"image_size": [640, 480]} if source == "camera" else {}
    hand: dict[str, Any] = {"image": "a.png"} if source == "image" else {}
    landmarks = given_camera(tmp_path, json.dumps({"K": SHARES, **extra}), **hand)
    assert landmarks.intrinsics is not None
    np.testing.assert_allclose(landmarks.intrinsics[1].numpy(), MATRIX)
    assert "look to be divided by the image's size" in caplog.text


def test_a_matrix_divided_by_an_unknown_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"divided by the image's size.*not known.*image_size"):
        given_camera(tmp_path, json.dumps(SHARES))
    with pytest.raises(ValueError, match=r"divided by the image's size.*not known"):
        read_landmarks(written(tmp_path, [{"landmarks": POINTS[0].tolist(), "K": SHARES}]))
    # Both rows divided by the width: the focal lengths would differ by 640 / 480.
    both = [[1.25, 0.0, 0.5], [0.0, 1.25, 0.375], [0.0, 0.0, 1.0]]
    with pytest.raises(ValueError, match="focal lengths are 800 and 600, which differ"):
        given_camera(tmp_path, json.dumps({"K": both, "image_size": [640, 480]}))


def test_a_matrix_of_an_enlarged_image_is_scaled(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Image.new("RGB", (640, 480)).save(tmp_path / "a.png")
    double = [[1600, 0, 660], [0, 1620, 470], [0, 0, 1]]
    camera = {"K": double, "image_size": [1280, 960]}
    landmarks = given_camera(tmp_path, json.dumps(camera), image="a.png")
    assert landmarks.intrinsics is not None
    assert landmarks.intrinsics.tolist() == [MATRIX] * 2
    assert (
        "is of an image of 1280 × 960 pixels, and the landmarks are of one of 640 × 480; it is scaled"
        in (caplog.text)
    )
    with pytest.raises(
        ValueError, match=r"image of 480 × 640 pixels.*another aspect: it is rotated"
    ):
        given_camera(tmp_path, json.dumps({"K": MATRIX, "image_size": [480, 640]}), image="a.png")


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ({"K": MATRIX, "image_size": [640, 480]}, ()),
        (MATRIX, ()),
        ({"K": MATRIX, "image_size": [1920, 1080]}, ("far from the middle of the image of 1920 × 1080",)),
        ([[800, 0, 2000], [0, 800, 1500], [0, 0, 1]], ("2 of 2 hands are more than 60° from the",)),
        ([[90, 0, 1500], [0, 90, 235], [0, 0, 1]], ("more than 60° from the camera's axis",)),
        ({"K": [[400, 0, 160], [0, 400, 120], [0, 0, 1]], "image_size": [320, 240]},
         ("most landmarks lie outside of the image", "320 × 240")),
    ],
)  # fmt: skip
def test_a_camera_of_another_image_is_warned_of(
    tmp_path: Path,
    camera: Any,  # noqa: ANN401
    words: tuple[str, ...],
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        given_camera(tmp_path, json.dumps(camera), POINTS + np.array([0, 40]))
    assert bool(caplog.text) == bool(words)
    assert all(part in caplog.text for part in words)
