"""Faults of real users' files, in an optional folder of cases; the other tests write the same from code."""

import logging
import os
from pathlib import Path

import numpy as np
import pytest

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.landmarks.splits import LandmarkRecipe, LandmarkSplits
from hand_recon.protocols.benchmarks import PROTOCOLS
from hand_recon.protocols.lint.lint import Finding, closing_line, lint
from hand_recon.protocols.prediction_files import read_pair


@pytest.fixture
def cases() -> Path:
    """Folder of the cases; skips where there is none."""
    folder = Path(os.environ.get("HAND_RECON_MATERIAL", "")) / "cases"
    if "HAND_RECON_MATERIAL" not in os.environ or not folder.is_dir():
        pytest.skip("HAND_RECON_MATERIAL names no folder with `cases`")
    return folder


def assert_same(left: ImageLandmarks, right: ImageLandmarks) -> None:
    np.testing.assert_array_equal(left.landmarks_2d.numpy(), right.landmarks_2d.numpy())
    np.testing.assert_array_equal(left.labelled.numpy(), right.labelled.numpy())
    for name in ("confidence", "sigma"):
        ours, theirs = getattr(left, name), getattr(right, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(ours.numpy(), theirs.numpy())


@pytest.mark.parametrize(
    ("case", "equivalent", "words"),
    [
        ("01-rtmpose-scores", "clipped.json", "confidences are above 1"),
        ("04b-mediapipe-z-positive", "no_z.json", "such as MediaPipe's z"),
        ("13-zeros-missing", "nulls.json", "exactly at (0, 0) without a score"),
    ],
)
def test_the_fault_is_said_and_the_hands_are_those_of_a_correct_file(
    cases: Path, case: str, equivalent: str, words: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(cases / case / "hands.json")
    assert words in caplog.text
    assert_same(landmarks, read_landmarks(cases / case / equivalent))


@pytest.mark.parametrize(
    ("case", "file", "message"),
    [
        ("03-depth-third", "hands.json", "look like depths in mm.*third_value=ignore"),
        ("14-freihand-xyz", "training_xyz.json", "3D points in metres.*Project them with the camera matrix"),
        ("14b-xyz-mm", "joints_mm.json", "3D points in millimetres.*Project them"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_landmarks_is_refused_with_the_cure(
    cases: Path, case: str, file: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        read_landmarks(cases / case / file)


def test_depths_can_be_left_out_by_the_option(cases: Path) -> None:
    folder = cases / "03-depth-third"
    ignored = read_landmarks(folder / "hands.json", assumed=Assumptions(third_value="ignore"))
    assert_same(ignored, read_landmarks(folder / "no_third.json"))


def test_the_order_of_the_landmarks_is_named(cases: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = cases / "09b-tip-first" / "hands.json"
    read_landmarks(path)
    assert "set order=interhand" in caplog.text
    caplog.clear()
    read_landmarks(path, assumed=Assumptions(order="interhand"))
    assert "order=" not in caplog.text


def test_distortion_and_image_size_of_a_camera_are_used_and_said(
    cases: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = cases / "32c-distortion-in-K"
    straight = read_landmarks(folder / "hands.json", folder / "K.json").landmarks_2d
    seen = read_landmarks(folder / "hands.json").landmarks_2d
    # Barrel distortion: straight landmarks are farther from the principal point (320, 240).
    middle = seen.new_tensor([320.0, 240.0])
    assert ((straight - middle).norm(dim=-1) >= (seen - middle).norm(dim=-1) - 1e-9).all()
    assert 1 < float((straight - seen).norm(dim=-1).max()) < 10
    assert "lens distortion, which is removed from 21 landmarks" in caplog.text
    assert "far from the middle of the image of 1920 × 1080" in caplog.text


def test_a_normalised_camera_is_refused_with_the_form_it_needs(cases: Path) -> None:
    folder = cases / "32g-normalised"
    with pytest.raises(ValueError, match=r"divided by the image's size.*multiply the first row"):
        read_landmarks(folder / "hands.json", folder / "K.json")


def table_of(folder: Path) -> np.ndarray:
    path = folder / "ann.json"
    recipe = LandmarkRecipe(path, path, path, images=folder / "pics")
    return LandmarkSplits(recipe).dataset("val").hands.landmarks_2d


def test_labels_of_stored_images_are_those_of_the_upright_ones(
    cases: Path, caplog: pytest.LogCaptureFixture
) -> None:
    upright = table_of(cases / "20b-exif-display")
    assert not caplog.text
    stored = table_of(cases / "20-exif-raw")
    assert "12 of 12 hands are in pixels of images as they are stored" in caplog.text
    np.testing.assert_allclose(stored, upright, atol=0.02)


def test_backslashes_lead_to_the_images(cases: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        assert len(table_of(cases / "23-windows-paths")) == 12
    assert "12 of 12 images are not at the written path" in caplog.text


def findings(folder: Path) -> tuple[Finding, ...]:
    protocol = PROTOCOLS["ho3d_v2"]
    pair = read_pair(folder / "pred.json", folder / "gt", protocol)
    return lint(pair.ground_truth, pair.prediction, protocol, pair.predicted_vertices)


def test_sequences_in_another_order_are_found(cases: Path) -> None:
    found = findings(cases / "40b-ho3d-sequences")
    assert [some.kind for some in found] == ["frame_order"]
    assert "your frames 0 to 109 fit the ground truth of 150 to 259" in found[0].message
    assert closing_line(found) is None


def test_frames_in_millimetres_are_found(cases: Path) -> None:
    found = findings(cases / "40c-some-mm")
    assert [some.kind for some in found] == ["some_unit"]
    assert "140 of your 400 frames (35 %) look to be in mm" in found[0].message
    assert "frames 260 to 399" in found[0].message
    assert closing_line(found) is None
