"""The tool that measures σ of landmarks: epipolar distances, calibration and table on made-up data."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hand_recon.detection.copies import COPIES
from hand_recon.detection.hands import HandReading
from hand_recon.detection.landmark_noise import SHARED, Features, NoiseTable, features, load_table
from landmark_noise.clip import (
    Camera,
    Clip,
    calibrate,
    epipolar_distance,
    fundamental_matrix,
    rank_correlation,
)
from landmark_noise.readings import CopiedHand, read_hands
from landmark_noise.table import fit_table, write_table
from measure_landmark_noise import evenly, main
from tests.detection.conftest import EXAMPLES, read


def camera(degrees: float, translation: tuple[float, float, float], focal: float) -> Camera:
    """A camera that is rotated about the vertical axis."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return Camera(
        np.array([[focal, 0, 360], [0, focal, 300], [0, 0, 1.0]]),
        np.zeros(5),
        np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]),
        np.array(translation),
    )


CAMERAS = camera(10, (0.1, 0, 1), 900), camera(-35, (-0.1, 0.05, 1.2), 700)


def seen(points: np.ndarray, by: Camera) -> np.ndarray:
    """Projections, pixels."""
    rays = (points @ by.rotation.T + by.translation) @ by.matrix.T
    return np.asarray(rays[..., :2] / rays[..., 2:])


def points_in_space(frames: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.1, 0.1, (frames, 21, 3))


def test_projections_of_one_point_meet_the_epipolar_constraint() -> None:
    points = points_in_space(10)
    one, other = (seen(points, by) for by in CAMERAS)
    distance, share = epipolar_distance(one, other, fundamental_matrix(*CAMERAS))
    np.testing.assert_allclose(distance, 0, atol=1e-9)
    assert ((share > 0) & (share < 1)).all()


@pytest.mark.parametrize("sigma", [(1.0, 1.0), (2.0, 0.1), (0.1, 2.0)])
def test_the_variance_of_the_distance_is_that_of_both_points(sigma: tuple[float, float]) -> None:
    rng, points = np.random.default_rng(1), points_in_space(2000)
    one, other = (
        seen(points, by) + rng.normal(scale=scale, size=(2000, 21, 2))
        for by, scale in zip(CAMERAS, sigma, strict=True)
    )
    distance, share = epipolar_distance(one, other, fundamental_matrix(*CAMERAS))
    expected = np.sqrt(share * sigma[0] ** 2 + (1 - share) * sigma[1] ** 2)
    assert (distance / expected).std() == pytest.approx(1, abs=0.02)


def test_points_along_an_epipolar_line_do_not_change_the_distance() -> None:
    points = points_in_space(10)
    fundamental = fundamental_matrix(*CAMERAS)
    one, other = (seen(points, by) for by in CAMERAS)
    centre = -CAMERAS[0].rotation.T @ CAMERAS[0].translation
    # Farther from the first camera on the same ray: the second image moves along the line.
    moved = seen(points + 0.2 * (points - centre), CAMERAS[1])
    assert np.abs(moved - other).max() > 5
    np.testing.assert_allclose(epipolar_distance(one, moved, fundamental)[0], 0, atol=1e-9)


def table_of(gain: float) -> NoiseTable:
    """A table by which the spread is a hundredth of the square, twice that in the thumb."""
    constant = np.full(21, math.log(0.01))
    constant[1:5] += math.log(2)
    return NoiseTable(constant, np.zeros(21), np.zeros(len(SHARED)), np.full(9, gain))


def clip_of(gain: float, frames: int) -> Clip:
    """Hands whose landmarks have noise of the table's spread times a gain."""
    rng, points, table = np.random.default_rng(2), points_in_space(frames), table_of(gain)
    hands = []
    for by in CAMERAS:
        exact = seen(points, by)
        each = []
        for landmarks in exact:
            reading = HandReading(landmarks, np.zeros((21, 3)), 0.9, 0.9)
            found = features(reading, 720, 720)
            plain = CopiedHand(reading, np.zeros((0, 21, 2)), found)
            sigma = gain * plain.side * table.spread(found)
            noisy = landmarks + rng.normal(size=(21, 2)) * sigma[:, None]
            each.append(replace(plain, reading=replace(reading, landmarks_2d=noisy)))
        hands.append(tuple(each))
    return Clip(CAMERAS, (hands[0], hands[1]), tuple(range(frames)))


def test_calibration_finds_the_gain_and_that_sigma_is_gaussian() -> None:
    found = calibrate(clip_of(1.7, 400), table_of(1.0), 0)
    assert found.gain == pytest.approx(1.7, rel=0.05)
    assert found.within[0] == pytest.approx(0.683, abs=0.02)
    assert found.within[1] == pytest.approx(0.954, abs=0.01)
    # Four landmarks of 21 have twice the noise.
    assert found.correlation > 0.2
    equal = calibrate(clip_of(1.7, 400), table_of(1.0), 0, "equal")
    assert equal.likelihood > found.likelihood + 0.05


def test_rank_correlation_of_a_rising_function_is_one() -> None:
    values = np.random.default_rng(0).normal(size=(3, 21))
    assert rank_correlation(values, np.exp(values)) == pytest.approx(1)
    assert rank_correlation(values, -values) == pytest.approx(-1)


def made_up_hands(table: NoiseTable, count: int) -> list[CopiedHand]:
    """Hands of random features, whose copies have exactly the table's spread."""
    rng, hands = np.random.default_rng(3), []
    landmarks = rng.uniform(0, 200, (21, 2))
    for _ in range(count):
        curl = rng.uniform(0, 2, 21)
        found = Features(rng.normal(size=(21, len(SHARED))), curl * (table.curl != 0))
        hand = CopiedHand(
            HandReading(landmarks, np.zeros((21, 3)), 0.9, 0.9), np.zeros((8, 21, 2)), found
        )
        # All copies are moved by (s, s), which is a spread of s per coordinate.
        moved = landmarks + (hand.side * table.spread(found))[:, None]
        hands.append(replace(hand, copies=np.repeat(moved[None], len(COPIES), axis=0)))
    return hands


def test_a_table_is_found_from_the_spreads_that_it_makes() -> None:
    rng = np.random.default_rng(4)
    curl = rng.uniform(-0.1, 0.3, 21)
    curl[[0, 1, 5, 9, 13, 17]] = 0
    expected = NoiseTable(
        rng.uniform(-4.5, -3.5, 21), curl, rng.uniform(-0.1, 0.1, len(SHARED)), np.ones(9)
    )
    found = fit_table(made_up_hands(expected, 2000), np.arange(9.0))
    np.testing.assert_allclose(found.constant, expected.constant, atol=0.01)
    np.testing.assert_allclose(found.curl, expected.curl, atol=0.01)
    np.testing.assert_allclose(found.shared, expected.shared, atol=0.01)
    np.testing.assert_allclose(found.gain, np.arange(9))


def test_a_written_table_is_read_as_it_was(tmp_path: Path) -> None:
    shipped = load_table()
    write_table(shipped, tmp_path / "table.yaml", "a command")
    again = load_table(tmp_path / "table.yaml")
    for name in ("constant", "curl", "shared", "gain"):
        np.testing.assert_array_equal(getattr(again, name), getattr(shipped, name))
    assert "#   a command" in (tmp_path / "table.yaml").read_text()


def test_names_are_spread_evenly() -> None:
    assert evenly(list("abcdef"), 3) == ["a", "c", "e"]
    assert evenly(list("ab"), 5) == evenly(list("ab"), 0) == ["a", "b"]
    assert evenly([], 4) == []


def test_an_image_is_read_once_and_in_eight_copies(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HAND_RECON_CACHE", str(models.parent))
    blank = np.full((80, 80, 3), 127, dtype=np.uint8)
    hand, nothing = read_hands([read(EXAMPLES / "hand.jpg"), blank])
    assert nothing is None
    assert hand is not None
    assert hand.copies.shape == (8, 21, 2)
    assert 0 < np.median(hand.spread(8)) < 0.1
    assert (hand.spread(1) >= 0).all()


def test_the_check_of_the_table_prints_its_agreement(
    models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("HAND_RECON_CACHE", str(models.parent))
    (tmp_path / "a").mkdir()
    cv2.imwrite(str(tmp_path / "a" / "b.png"), read(EXAMPLES / "hand.jpg")[..., ::-1])
    rows = [{"image": "a/b.png"}, {"image": "c/missing.png"}]
    (tmp_path / "test.json").write_text(json.dumps(rows))
    words = [
        "measure_landmark_noise",
        "check",
        str(tmp_path),
        "--labels",
        "test.json",
        "--only",
        "a",
    ]
    monkeypatch.setattr(sys, "argv", words)
    main()
    printed = capsys.readouterr().out
    assert "1 images, 1 hands" in printed
    assert "rank correlation" in printed
