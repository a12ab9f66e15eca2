"""`predict … ckpt=` with boxes or whole images: the network finds the landmarks itself."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from hand_recon.runs.predict_run import predict
from tests.support.photo_checkpoint import write_networks
from tests.support.photo_folder import CAMERA, SCHEMA, asked, read, texture, with_boxes


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_networks(tmp_path_factory.mktemp("runs"))


@pytest.fixture
def folder(folder: Path) -> Path:
    return texture(folder)


def test_boxes_need_no_models_of_mediapipe(folder: Path, runs: Path) -> None:
    """The network finds the landmarks of the crop, and the fit is to them, with its σ."""
    summary = predict(asked(folder, f"ckpt='{runs}/photos'", detector=with_boxes(folder)))
    assert (summary["hands"], summary["fitted"]) == (3, 3)
    entries = read(folder / "out")
    jsonschema.validate(entries, SCHEMA)
    boxes = json.loads((folder / "boxes.json").read_text(encoding="utf-8"))
    assert [entry["side"] for entry in entries] == ["right", "right", "left"]
    for entry, box in zip(entries, boxes, strict=True):
        assert entry["source"].startswith("boxes, checkpoint photos/checkpoints/best.ckpt ")
        assert entry["score"] is None
        assert entry["sigma_2d"] is not None
        seen, corners = np.array(entry["observed_2d"]), np.array(box["box"]).reshape(2, 2)
        extent = (corners[1] - corners[0]).max()
        assert (np.abs(seen - corners.mean(axis=0)) < 2 * extent).all()
    assert not list(folder.rglob("*.tflite"))


def test_boxes_without_steps_are_the_networks_hands_at_their_place(
    folder: Path, runs: Path
) -> None:
    """A network of images has no landmarks but its hand's projections."""
    words = ("descent.steps=0", f"ckpt='{runs}/images'")
    predict(asked(folder, *words, detector=with_boxes(folder)))
    for entry in read(folder / "out"):
        np.testing.assert_allclose(entry["observed_2d"], entry["landmarks_2d"], atol=0.01)
        assert entry["residual"] < 0.01


def test_whole_images_and_boxes_need_a_side(folder: Path, runs: Path) -> None:
    ckpt, whole = f"ckpt='{runs}/photos'", ("detector=whole",)
    with pytest.raises(ValueError, match=r"detector=whole with ckpt=… needs the side"):
        predict(asked(folder, ckpt, detector=whole))
    boxes = with_boxes(folder, sides=False)
    with pytest.raises(ValueError, match="3 of 3 boxes have no side"):
        predict(asked(folder, ckpt, detector=boxes))
    assert not (folder / "out").exists()
    predict(asked(folder, ckpt, "side=left", detector=boxes))
    assert {entry["side"] for entry in read(folder / "out")} == {"left"}
    words = (ckpt, "side=right", f"output='{folder}/whole'")
    assert predict(asked(folder, *words, detector=whole))["hands"] == 3
    assert {entry["side"] for entry in read(folder / "whole")} == {"right"}


@pytest.mark.slow
def test_a_camera_with_lens_distortion_moves_the_landmarks_that_the_network_finds(
    folder: Path, runs: Path
) -> None:
    """Crops are cut from the photograph as it is; the landmarks of the fit are without distortion."""
    ckpt, boxes = f"ckpt='{runs}/photos'", with_boxes(folder)
    predict(asked(folder, ckpt, f"output='{folder}/plain'", detector=boxes))
    camera = {"camera_matrix": CAMERA, "distortion_coefficients": [0.2, 0.0, 0.0, 0.0, 0.0]}
    (folder / "K.json").write_text(json.dumps(camera))
    predict(asked(folder, ckpt, f"output='{folder}/lens'", detector=boxes))
    for plain, lens in zip(read(folder / "plain"), read(folder / "lens"), strict=True):
        seen, straight = np.array(plain["observed_2d"]), np.array(lens["observed_2d"])
        # Barrel or pincushion: straight = x with distorted = x (1 + 0.2 r²) about the principal point.
        x = (straight - [320.0, 240.0]) / 700.0
        again = 700.0 * x * (1 + 0.2 * (x**2).sum(axis=1, keepdims=True)) + [320.0, 240.0]
        np.testing.assert_allclose(again, seen, atol=0.1)
        assert np.abs(straight - seen).max() > 0.01
