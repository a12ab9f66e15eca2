"""Checkpoints of networks that look at photographs: loading, and refusals."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest
import torch

from hand_recon.detection.detector import DetectedHand
from hand_recon.hand.model import HandModel
from hand_recon.runs.fitters import build_objective
from hand_recon.runs.photo_checkpoint import (
    checkpoint_file,
    gives_boxes_alone,
    origin_name,
    with_network,
)
from hand_recon.runs.sigma_calibration import SIGMA_FACTOR_KEY
from tests.support.mano_file import write_mano_folder
from tests.support.photo_checkpoint import IMAGES, LIFTER, PHOTOS, asked, loaded, write_run
from tests.support.tolerance import assert_close


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of three untrained networks."""
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "photos", *PHOTOS)
    write_run(folder / "images", *IMAGES)
    write_run(folder / "lifter", *LIFTER)
    return folder


def test_without_a_checkpoint_nothing_is_loaded_or_changed() -> None:
    config = asked()
    assert with_network(config) == (config, None)
    assert config.lifter == "default"


def test_the_start_of_the_network_takes_the_place_of_the_lifters(runs: Path) -> None:
    config, network = with_network(asked(f"ckpt='{runs}/photos'"))
    assert config.lifter == "none"
    assert network is not None
    assert (network.crop.size, network.crop.around, network.crop.expansion) == (64, "joints", 1.5)
    assert network.sees_landmarks
    assert network.finds_landmarks
    assert not network.regressor.training
    assert not loaded(runs / "images").sees_landmarks


def test_the_pose_in_pixels_is_asked_for_where_the_fit_uses_it(runs: Path, hand: HandModel) -> None:
    words = f"ckpt='{runs}/photos'"
    term = build_objective(asked(words), hand).seen_pose_term
    assert term is not None
    assert term.weight == 1.0
    assert loaded(runs / "photos").sees_pose
    assert build_objective(asked(words, "seen_pose_weight=0"), hand).seen_pose_term is None
    assert not loaded(runs / "photos", "seen_pose_weight=0").sees_pose
    assert not loaded(runs / "photos", "descent.steps=0").sees_pose
    assert build_objective(asked(), hand).seen_pose_term is None


def test_a_network_is_read_once_until_its_file_changes(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", *IMAGES)
    first = loaded(run).regressor
    assert loaded(run / "checkpoints" / "best.ckpt").regressor is first
    content = torch.load(run / "checkpoints" / "best.ckpt", weights_only=True)
    content["state_dict"]["regressor.initial_state"] += 1.0
    torch.save(content, run / "checkpoints" / "best.ckpt")
    second = loaded(run).regressor
    assert_close(second.initial_state, first.initial_state + 1.0)


def test_lifters_are_refused_with_the_cure(runs: Path, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"lifter.*best\.ckpt is a lifter: it sees.*lifter=.*best\.ckpt"
    ):
        loaded(runs / "lifter")
    (tmp_path / "own.safetensors").write_bytes(b"weights")
    with pytest.raises(ValueError, match=r"file of a lifter.*Give it as lifter=.*own\.safetensors"):
        checkpoint_file(str(tmp_path / "own.safetensors"))
    with pytest.raises(ValueError, match=r"Found ckpt=.* and lifter=own; each gives the start"):
        loaded(runs / "photos", "lifter=own")
    with pytest.raises(FileNotFoundError, match=r"No checkpoint at .*Give ckpt=<folder of a run>"):
        loaded(tmp_path)


def test_a_network_of_another_hand_is_refused(runs: Path, tmp_path: Path) -> None:
    folder = write_mano_folder(tmp_path)
    with pytest.raises(
        ValueError, match=r"trained with the hand 'open .*found 'mano .*Use hand=open"
    ):
        loaded(runs / "photos", "hand=mano", f"hand.path='{folder}'")


def test_boxes_alone_are_fitted_with_the_landmark_set_of_the_network(
    runs: Path, caplog: pytest.LogCaptureFixture
) -> None:
    words = (f"ckpt='{runs}/photos'", "detector=whole", "side=right")
    with caplog.at_level(logging.INFO):
        config, network = with_network(asked(*words, "landmark_set=knuckle"))
    assert config.hand.landmark_set == "mediapipe"
    assert network is not None
    assert network.finds_landmarks
    assert "of the set mediapipe, which is fitted" in caplog.text
    assert gives_boxes_alone(config)
    assert not gives_boxes_alone(asked("detector=whole"))
    assert not gives_boxes_alone(asked(f"ckpt='{runs}/photos'"))


def test_the_origin_of_hands_names_the_checkpoint(runs: Path, tmp_path: Path) -> None:
    file = runs / "photos" / "checkpoints" / "best.ckpt"
    name = origin_name(file)
    assert name.startswith("checkpoint photos/checkpoints/best.ckpt ")
    (tmp_path / "mine.ckpt").write_bytes(file.read_bytes())
    # The digest is that of the content, wherever it lies.
    assert origin_name(tmp_path / "mine.ckpt") == f"checkpoint mine.ckpt {name.split()[-1]}"
    assert json.dumps(name)


def test_the_hand_of_the_fit_is_that_of_the_network(runs: Path, hand: HandModel) -> None:
    network = loaded(runs / "photos")
    assert network.regressor.hand.name == hand.name
    assert network.regressor.use_intrinsics


def test_sigma_of_the_network_is_multiplied_by_the_factor_of_its_checkpoint(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", *PHOTOS)
    file = run / "checkpoints" / "best.ckpt"
    assert loaded(run).sigma_factor == 1.0
    checkpoint = torch.load(file, weights_only=True)
    torch.save(checkpoint | {SIGMA_FACTOR_KEY: 1.7}, tmp_path / "best.ckpt")
    plain = loaded(run)
    calibrated = loaded(tmp_path / "best.ckpt")
    assert calibrated.sigma_factor == 1.7
    assert loaded(tmp_path / "best.ckpt", "calibrated_sigma=false").sigma_factor == 1.0
    pixels = np.random.default_rng(5).integers(0, 255, (200, 240, 3)).astype(np.uint8)
    points = np.random.default_rng(6).uniform((20, 30), (110, 150), (21, 2))
    hand = DetectedHand(points, "right", 0.9, 1.0)
    camera = np.array([[500.0, 0.0, 120.0], [0.0, 500.0, 100.0], [0.0, 0.0, 1.0]])
    before, after = (
        network.place(pixels, [hand], frozenset(), camera)[1] for network in (plain, calibrated)
    )
    assert_close(after.log_sigma.exp().float(), 1.7 * before.log_sigma.exp().float())
    assert_close(after.parameters.joint_angles, before.parameters.joint_angles)
