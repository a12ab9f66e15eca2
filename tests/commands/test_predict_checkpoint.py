"""`predict … ckpt=`: a network looks at the photographs, and its hand starts the fit or is the result."""

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import torch

import hand_recon
from hand_recon.runs import looking, predict_run
from hand_recon.runs.predict_run import predict
from tests.support.detector_models import published_models
from tests.support.photo_checkpoint import IMAGES, LIFTER, PHOTOS, write_networks, write_run
from tests.support.photo_folder import (
    CAMERA,
    QUICK,
    SCHEMA,
    asked,
    read,
    table,
    texture,
    with_boxes,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
TWO, LEFT = "1 two.png", "3 hånd's, [left].png"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_networks(tmp_path_factory.mktemp("runs"))


@pytest.fixture
def folder(folder: Path) -> Path:
    return texture(folder)


@pytest.mark.parametrize("run", ["photos", "images"])
def test_the_networks_hand_starts_the_fit_to_the_detectors_landmarks(
    folder: Path, runs: Path, run: str
) -> None:
    summary = predict(asked(folder, f"ckpt='{runs}/{run}'", "seen_pose_weight=0"))
    assert (summary["hands"], summary["fitted"]) == (3, 3)
    entries = read(folder / "out")
    jsonschema.validate(entries, SCHEMA)
    given = json.loads((folder / "found.json").read_text(encoding="utf-8"))
    predict(asked(folder, "lifter=none", f"output='{folder}/alone'"))
    for entry, alone in zip(entries, read(folder / "alone"), strict=True):
        # With one start more, the loss is no larger, but for the selection of starts.
        assert entry["loss"]["total"] < 1.02 * alone["loss"]["total"]
    for entry, landmarks in zip(entries, given, strict=True):
        assert entry["source"].startswith(f"landmarks, checkpoint {run}/checkpoints/best.ckpt ")
        assert entry["source"].endswith(", fit")
        np.testing.assert_allclose(entry["observed_2d"], landmarks["landmarks"], atol=1e-3)
        assert np.linalg.eigvalsh(entry["covariance_3d"]).min() > 0
        # The landmarks of the file have neither σ nor scores.
        assert entry["sigma_2d"] is None
    assert hand_recon.read_hands(folder / "out" / "hands.json").sides == ("right", "right", "left")
    assert [row["hands"] for row in table(folder / "out" / "images.csv")] == ["2", "0", "1"]


def test_the_fit_is_kept_near_the_pose_that_the_network_sees(
    folder: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An untrained network finds the landmarks elsewhere.
    monkeypatch.setattr("hand_recon.fitting.seen_pose.AGREES", 1e6)
    distances = {}
    for weight in (0, 1, 1000):
        words = (f"ckpt='{runs}/photos'", f"seen_pose_weight={weight}")
        predict(asked(folder, *words, f"output='{folder}/{weight}'"))
        losses = [entry["loss"] for entry in read(folder / str(weight))]
        distances[weight] = [loss.get("seen_pose") for loss in losses]
    assert distances[0] == [None, None, None]
    for near, far in zip(distances[1000], distances[1], strict=True):
        assert 0 < near < 0.2 * far


def test_the_start_matters_where_it_is_the_only_one(folder: Path, runs: Path) -> None:
    """Without starts in closed form, a fit from another network's hand ends elsewhere."""
    losses = []
    for run in ("photos", "images"):
        words = (f"ckpt='{runs}/{run}'", "descent.starts=0", f"output='{folder}/from {run}'")
        predict(asked(folder, *words))
        losses.append([entry["loss"]["total"] for entry in read(folder / f"from {run}")])
    assert losses[0] != losses[1]


@pytest.mark.parametrize("run", ["photos", "images"])
def test_without_steps_the_networks_hand_is_the_result(folder: Path, runs: Path, run: str) -> None:
    predict(asked(folder, f"ckpt='{runs}/{run}'", "descent.steps=0"))
    entries = read(folder / "out")
    jsonschema.validate(entries, SCHEMA)
    for entry in entries:
        assert entry["source"].split(", ")[0] == "landmarks"
        assert "fit" not in entry["source"].split(", ")
        assert entry["covariance_3d"] is None
        assert entry["loss"] == {}
        # σ of each coordinate is the network's own.
        assert len({round(one, 3) for row in entry["sigma_2d"] for one in row}) > 2
        points = np.array(entry["landmarks_3d"])
        on_plane = points / points[:, 2:] @ np.array(CAMERA).T
        np.testing.assert_allclose(on_plane[:, :2], entry["landmarks_2d"], atol=0.05)


def test_a_wrong_checkpoint_claims_no_folder(folder: Path, runs: Path, tmp_path: Path) -> None:
    lifter = write_run(tmp_path / "lifter", *LIFTER)
    for ckpt, message in ((lifter, "is a lifter"), (tmp_path / "gone", "No checkpoint at")):
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            predict(asked(folder, f"ckpt='{ckpt}'"))
    with pytest.raises(ValueError, match="each gives the start of a fit"):
        predict(asked(folder, f"ckpt='{runs}/photos'", f"lifter='{lifter}'"))
    assert not (folder / "out").exists()


@pytest.mark.slow
def test_an_interrupted_command_goes_on_with_the_same_checkpoint_alone(
    folder: Path, runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(predict_run, "PHOTOS_AT_ONCE", 1)
    own = write_run(tmp_path / "own", *PHOTOS, sharpness=1e4)
    ckpt = f"ckpt='{own}'"
    predict(asked(folder, ckpt, f"output='{folder}/whole'"))
    real, looks = looking.look_at_file, itertools.count()

    def interrupted(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        if next(looks) == 2:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(predict_run, "look_at_file", interrupted)
    with pytest.raises(KeyboardInterrupt):
        predict(asked(folder, ckpt))
    with pytest.raises(
        FileExistsError, match="unfinished results of a command with other files, opt"
    ):
        predict(asked(folder))
    with pytest.raises(
        FileExistsError, match="unfinished results of a command with other files, opt"
    ):
        predict(asked(folder, f"ckpt='{runs}/photos'"))
    file = own / "checkpoints" / "best.ckpt"
    before, times = file.read_bytes(), file.stat()
    content = torch.load(file, weights_only=True)
    content["state_dict"]["regressor.initial_state"] += 0.1
    torch.save(content, file)
    with pytest.raises(
        FileExistsError, match="unfinished results of a command with other files, and"
    ):
        predict(asked(folder, ckpt))
    file.write_bytes(before)
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert predict(asked(folder, ckpt))["hands"] == 3
    assert next(looks) == 4
    assert (folder / "out" / "hands.json").read_bytes() == (
        folder / "whole" / "hands.json"
    ).read_bytes()


def test_one_person_has_one_shape_beside_a_checkpoint(folder: Path, runs: Path) -> None:
    predict(asked(folder, f"ckpt='{runs}/photos'", "same_person=true"))
    shapes = [entry["shape"] for entry in read(folder / "out")]
    assert shapes[0] == shapes[1] == shapes[2]
    with pytest.raises(ValueError, match=r"same_person=true with descent\.steps=0"):
        predict(
            asked(
                folder, f"ckpt='{runs}/photos'", "same_person=true", "descent.steps=0",
                f"output='{folder}/none'",
            )
        )  # fmt: skip


def test_a_network_that_diverged_is_an_error_of_each_photograph(
    folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = write_run(tmp_path / "run", *IMAGES)
    file = run / "checkpoints" / "best.ckpt"
    content = torch.load(file, weights_only=True)
    content["state_dict"]["regressor.decoders.shape.bias"][:] = torch.nan
    torch.save(content, file)
    with pytest.raises(ValueError, match="2 of 3 images could not be processed"):
        predict(asked(folder, f"ckpt='{run}'"))
    assert "its training diverged" in caplog.text


def test_the_python_call_gives_what_the_command_writes(folder: Path, runs: Path) -> None:
    photos = [folder / "photos" / name for name in (TWO, LEFT)]
    landmarks = ("detector=landmarks", f"detector.landmarks='{folder}/found.json'")
    for name, detector in (("landmarks", landmarks), ("boxes", with_boxes(folder))):
        words = (f"ckpt='{runs}/photos'", "camera='fov=60'", f"output='{folder}/{name}'")
        config = asked(folder, *words, detector=detector)
        config.input = [str(photo) for photo in photos]
        predict(config)
        hands = hand_recon.reconstruct(
            photos, camera="fov=60", ckpt=runs / "photos", overrides=[*detector, *QUICK]
        )
        assert json.loads(json.dumps(hands.entries())) == read(folder / name)
    with pytest.raises(
        ValueError, match="'ckpt=x' has no effect here: ckpt is an argument of reconst"
    ):
        hand_recon.reconstruct(photos, overrides=["ckpt=x"])
    with pytest.raises(FileNotFoundError, match="No checkpoint at"):
        hand_recon.reconstruct(photos, ckpt=folder / "gone")


def test_an_array_is_a_whole_image_of_a_hand(runs: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (80, 60, 3)).astype(np.uint8)
    overrides = ["detector=whole", "side=left", "descent.steps=0"]
    hands = hand_recon.reconstruct(pixels, ckpt=runs / "photos", overrides=overrides)
    assert hands.sides == ("left",)
    assert hands.landmarks_3d.shape == (1, 21, 3)
    assert hands.records.sources[0].startswith("whole, checkpoint photos/")


def test_examples_with_mediapipes_landmarks(runs: Path, tmp_path: Path) -> None:
    models = published_models()
    words = [
        sys.executable, "-m", "hand_recon", "predict", "hand.jpg", "two_hands.jpg", "--ckpt",
        str(runs / "photos"), "--output", str(tmp_path / "out"), "--detector.models", str(models),
        "descent.starts=1",
    ]  # fmt: skip
    subprocess.run(words, cwd=EXAMPLES, check=True, capture_output=True)  # noqa: S603  # our own words
    entries = read(tmp_path / "out")
    jsonschema.validate(entries, SCHEMA)
    assert [entry["image"] for entry in entries] == ["hand.jpg", "two_hands.jpg", "two_hands.jpg"]
    for entry in entries:
        assert entry["source"].startswith("mediapipe, checkpoint photos/checkpoints/best.ckpt ")
        assert entry["verdict"] == "plausible"
        assert entry["sigma_2d"] is not None
    assert (tmp_path / "out" / "index.html").is_file()


@pytest.mark.slow
def test_hands_on_standard_output(folder: Path, runs: Path) -> None:
    words = [
        sys.executable, "-m", "hand_recon", "predict", f"photos/{TWO}", "--json", "-", "--side", "right",
        "detector=whole", f"ckpt={runs}/images", "descent.steps=0",
    ]  # fmt: skip
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)  # noqa: S603
    entries = json.loads(done.stdout)
    jsonschema.validate(entries, SCHEMA)
    assert entries[0]["source"].startswith("whole, checkpoint images/checkpoints/best.ckpt ")
