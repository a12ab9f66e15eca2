"""Lifters by name, beside which prior they are the default, and the starts that they give to other hands."""

import logging
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from depth.methods import TABLE_1
from hand_recon.camera import default_intrinsics, project
from hand_recon.command_line.configuration_files import CONF
from hand_recon.fitting.lift import lifted_start
from hand_recon.fitting.observation import Observation
from hand_recon.fitting.start import Start
from hand_recon.hand.mano.hand import mano_hand
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.lifter_file import (
    SHIPPED,
    LifterSettings,
    fingerprint,
    lifter_header,
    save_lifter,
)
from hand_recon.runs.fit_run import source_of
from hand_recon.runs.fitters import build_fitter
from hand_recon.runs.lifters import (
    DEFAULT,
    load_named,
    names_lifter,
    same_hand,
    starts_of,
)
from tests.support.configurations import composed
from tests.support.mano_file import write_mano_folder
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

ROOT = Path(CONF).parent


def seen(hand: HandModel, count: int = 8) -> Observation:
    """Exact landmarks of known hands in a crop."""
    batch = views(hand, known_hands(hand, count))
    camera = default_intrinsics(224, batch.landmarks_2d).expand(count, 3, 3)
    return Observation(batch.landmarks_2d, batch.labelled, camera)


@pytest.fixture(scope="module")
def packaged() -> HandModel:
    """The packaged lifter's own hand, with its landmark set."""
    return open_hand("mediapipe")


@pytest.fixture(scope="module")
def mano(tmp_path_factory: pytest.TempPathFactory) -> HandModel:
    return mano_hand(write_mano_folder(tmp_path_factory.mktemp("mano")))


def test_the_packaged_lifter_is_small_and_described_by_its_card(hand: HandModel) -> None:
    header = lifter_header(SHIPPED)
    assert SHIPPED.stat().st_size <= 4_000_000
    assert header["hand"] == fingerprint(hand)
    assert header["landmark_set"] == "mediapipe"
    card = (ROOT / "docs" / "lifter.md").read_text(encoding="utf-8")
    assert header["weights"] in card
    assert header["hand"] in card
    assert header["command"] in card
    assert f"{int(header['steps']):,} steps" in card


def test_values_that_mean_no_lifter() -> None:
    assert not any(map(names_lifter, (None, "none", "null", "", "None", "NONE", "Null")))
    assert all(map(names_lifter, ("default", "run", "own.safetensors")))


def test_the_packaged_lifter_is_the_default_beside_all_knowledge_alone() -> None:
    members = {path.stem for path in (Path(CONF) / "prior").glob("*.yaml")}
    for name, more in (("fit", []), ("predict", ["input=[]"])):
        found = {prior: composed(f"prior={prior}", *more, name=name).lifter for prior in members}
        knowing = {"full", "natural", "photos"}
        assert found == {prior: "default" if prior in knowing else "none" for prior in members}
        for term in ("non_penetration", "shape", "range_of_motion.anatomy"):
            assert composed(f"prior.{term}=null", *more, name=name).lifter == "none"
        assert composed("prior=none", "lifter=default", *more, name=name).lifter == "default"


def test_the_rows_of_table_1_by_fitting_use_neither_lifter_nor_table_of_fingers() -> None:
    lines = (ROOT / "Makefile").read_text().splitlines()
    (line,) = (line for line in lines if "hand_recon.fit -m" in line and "+experiment" in line)
    for override in ("lifter=none", "descent.finger_table=false"):
        assert f" {override} " in line
        assert all(override in row for row in TABLE_1.values())


@pytest.mark.parametrize(
    ("words", "source"),
    [([], "landmarks, lifter, fit"), (["lifter=none"], "landmarks, fit"), (["lifter=null"], "landmarks, fit"),
     (["prior=none"], "landmarks, fit"), (["descent.steps=0"], "landmarks, lifter")],
)  # fmt: skip
def test_results_say_where_they_started(hand: HandModel, words: list[str], source: str) -> None:
    assert source_of(composed(*words, name="fit"), hand).source == source


def off_landmarks(hand: HandModel, start: Start, observation: Observation) -> torch.Tensor:
    """Distance of a start's projections from landmarks, as a share of the hand's size in the image."""
    posed = hand(start.joint_angles[:, 0], start.shape[:, 0]).landmarks
    placed = posed @ start.root_rotation[:, 0].mT + start.translation
    off = (project(placed, observation.intrinsics) - observation.landmarks_2d).norm(dim=-1)
    size = observation.landmarks_2d.amax(dim=1) - observation.landmarks_2d.amin(dim=1)
    return off / size.amax(dim=1, keepdim=True)


def test_the_packaged_lifter_finds_hands_that_it_never_saw(packaged: HandModel) -> None:
    """Its own hand model, exact landmarks: the start projects to near them."""
    observation = seen(packaged, 32)
    start = starts_of(load_named(DEFAULT, packaged), packaged)(observation)
    assert float(off_landmarks(packaged, start, observation).mean()) < 0.04


def test_the_lifters_own_hand_is_not_built_twice(packaged: HandModel, hand: HandModel) -> None:
    assert load_named(DEFAULT, packaged).hand is packaged
    lifter = load_named(DEFAULT, hand)
    assert lifter.hand.landmark_set == packaged.landmark_set
    assert same_hand(lifter, hand)


@pytest.mark.parametrize("landmark_set", ["knuckle", "mano"])
def test_a_start_carries_over_to_another_landmark_set(
    landmark_set: str, caplog: pytest.LogCaptureFixture
) -> None:
    """The hand is the same one, so that its shape stays; only the position is found again."""
    other = open_hand(landmark_set)
    observation, lifter = seen(other, 32), load_named(DEFAULT, other)
    with caplog.at_level(logging.INFO):
        start = starts_of(lifter, other)(observation)
    assert not caplog.text
    own = lifted_start(lifter, observation)
    for kept in ("joint_angles", "root_rotation", "shape"):
        assert_close(getattr(start, kept), getattr(own, kept))
    assert float(off_landmarks(other, start, observation).mean()) < 0.08


def test_a_start_carries_over_to_another_hand(
    mano: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    """A hand in MANO's layout: angles and rotation stay, shape does not, and a note says so."""
    observation, lifter = seen(mano, 32), load_named(DEFAULT, mano)
    assert not same_hand(lifter, mano)
    with caplog.at_level(logging.INFO):
        start = starts_of(lifter, mano)(observation)
    assert "start the fit of the hand mano, its shape does not" in caplog.text
    own = lifted_start(lifter, observation)
    assert_close(start.joint_angles, own.joint_angles)
    assert_close(start.root_rotation, own.root_rotation)
    assert not start.shape.any()
    assert float(off_landmarks(mano, start, observation).mean()) < 0.1


def test_a_prediction_for_another_hand_is_no_result(mano: HandModel) -> None:
    config = composed("descent.steps=0", "lifter=default", name="fit")
    with pytest.raises(ValueError, match=r"descent\.steps=0.*lifter=default.*found 'mano'"):
        build_fitter(config, mano)


def test_a_file_of_ones_own_is_a_lifter(hand: HandModel, tmp_path: Path) -> None:
    settings = LifterSettings(width=16, depth=1)
    network = settings.build(hand).eval()
    file = tmp_path / "own.safetensors"
    save_lifter(file, network, settings, {})
    given = seen(hand)
    found, expected = lifted_start(load_named(str(file), hand), given), lifted_start(network, given)
    # Weights lose digits in half precision.
    assert float((found.joint_angles - expected.joint_angles).abs().max()) < 1e-2


def test_a_folder_without_a_checkpoint_is_no_lifter(hand: HandModel, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="No checkpoint at"):
        load_named(str(tmp_path), hand)


@pytest.mark.parametrize(
    "name", ["defaults", "Default", "outputs/no run", "no.ckpt", "no.safetensors"]
)
def test_a_name_of_nothing_is_answered_with_those_that_there_are(
    hand: HandModel, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        FileNotFoundError, match=rf"{name}.* Give lifter=default.*none.*safetensors"
    ):
        load_named(name, hand)


def test_missing_landmarks_and_cameras_move_the_start_with_them(packaged: HandModel) -> None:
    """With four landmarks hidden and another focal length, the start stays where the landmarks are."""
    observation = seen(packaged, 32)
    camera = observation.intrinsics.clone()
    camera[:, 0, 0] = camera[:, 1, 1] = 900.0
    labelled = observation.labelled.clone()
    labelled[:, [4, 8, 11, 17]] = False
    hidden = replace(observation, intrinsics=camera, labelled=labelled)
    start = lifted_start(load_named(DEFAULT, packaged), hidden)
    assert float(off_landmarks(packaged, start, hidden)[labelled].mean()) < 0.06
