"""σ of the detector's landmarks: features by hand, the table, its agreement with photographs."""

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.boxes import WholeImageDetector
from hand_recon.detection.copies import COPIES
from hand_recon.detection.hands import HandReading
from hand_recon.detection.landmark_noise import (
    SHARED,
    SPREAD_BOUNDS,
    Features,
    LandmarkNoise,
    NoiseTable,
    combined_spread,
    features,
    load_table,
)
from hand_recon.detection.mediapipe import MediaPipeDetector
from hand_recon.detection.regions import Region, region_of_landmarks
from tests.detection.conftest import read


def flat_hand() -> HandReading:
    """A hand with straight fingers, parallel to the image, 500 px per metre from (200, 300)."""
    points = np.zeros((21, 3))
    for finger in range(5):
        across = 0.03 * (finger - 2)
        for joint in range(4):
            points[1 + 4 * finger + joint] = [across, -0.08 - 0.03 * joint, 0]
    return HandReading(points[:, :2] * 500 + [200, 300], points, 0.99, 0.9)


def shared(reading: HandReading, name: str, size: tuple[int, int] = (400, 400)) -> np.ndarray:
    return features(reading, *size).shared[:, SHARED.index(name)]


def test_doubt_is_the_power_of_ten_of_absence() -> None:
    for presence, doubt, strong in (
        (0.9, -1, 1),
        (0.99, -2, 0),
        (0.999, -3, 0),
        (1.0, -4, 0),
        (0.0, 0, 2),
    ):
        reading = replace(flat_hand(), presence=presence)
        np.testing.assert_allclose(shared(reading, "doubt"), doubt, atol=1e-9)
        np.testing.assert_allclose(shared(reading, "strong_doubt"), strong, atol=1e-9)


@pytest.mark.parametrize("degrees", [0, 30, 60, 90, 150])
def test_facing_is_the_cosine_of_the_palms_inclination(degrees: float) -> None:
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    about_y = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    reading = replace(flat_hand(), landmarks_3d=flat_hand().landmarks_3d @ about_y.T)
    np.testing.assert_allclose(shared(reading, "facing"), abs(cosine), atol=1e-12)
    np.testing.assert_allclose(shared(reading, "doubt_facing"), -2 * abs(cosine), atol=1e-9)


def test_curl_sums_the_angles_between_bones_up_to_the_landmark() -> None:
    reading = flat_hand()
    # The middle finger points along the palm: no curl anywhere.
    np.testing.assert_allclose(features(reading, 400, 400).curl[9:13], 0, atol=1e-6)
    points = reading.landmarks_3d.copy()
    # Its PIP is bent by a right angle, its DIP by 45 degrees more.
    points[11] = points[10] + [0, 0, -0.02]
    points[12] = points[11] + np.array([0, 0.02, -0.02])
    curl = features(replace(reading, landmarks_3d=points), 400, 400).curl
    np.testing.assert_allclose(curl[9:13], np.radians([0, 0, 90, 135]), atol=1e-6)
    np.testing.assert_allclose(curl[[0, 1, 5, 9, 13, 17]], 0)


def test_landmarks_outside_the_image_by_a_fiftieth_of_the_square_are_outside() -> None:
    reading = flat_hand()
    side = region_of_landmarks(reading.landmarks_2d).side
    assert not shared(reading, "outside").any()
    for over, outside in ((0.019, 0), (0.021, 1)):
        moved = replace(
            reading, landmarks_2d=reading.landmarks_2d + np.array([0, 100 + over * side])
        )
        found = shared(moved, "outside")
        assert found[0] == outside
        assert not found[1:].any()


@given(
    st.floats(0.2, 5), st.floats(0, 6.3), st.floats(-50, 50), st.booleans(), st.integers(0, 1000)
)
def test_the_spread_does_not_depend_on_size_place_rotation_or_side(
    scale: float, angle: float, move: float, mirrored: bool, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    hand = flat_hand()
    hand = replace(
        hand,
        landmarks_3d=hand.landmarks_3d + rng.normal(scale=0.01, size=(21, 3)),
        landmarks_2d=hand.landmarks_2d - [200, 250],
    )
    change = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    change = change @ np.diag([-1 if mirrored else 1, 1])
    in_space = np.eye(3)
    in_space[:2, :2] = change
    far = 1e5
    middle = far / 2
    other = replace(
        hand,
        landmarks_2d=scale * hand.landmarks_2d @ change.T + middle + move,
        landmarks_3d=hand.landmarks_3d @ in_space.T,
    )
    hand = replace(hand, landmarks_2d=hand.landmarks_2d + middle)
    one, two = (features(which, int(far), int(far)) for which in (hand, other))
    np.testing.assert_allclose(two.curl, one.curl, atol=1e-6)
    invariant = [index for index, name in enumerate(SHARED) if "extent" not in name]
    np.testing.assert_allclose(two.shared[:, invariant], one.shared[:, invariant], atol=1e-6)


def test_degenerate_readings_have_finite_spreads() -> None:
    for landmarks in (np.zeros((21, 2)), np.full((21, 2), 1e6)):
        reading = HandReading(landmarks, np.zeros((21, 3)), 0.7, 0.5)
        spread = load_table().spread(features(reading, 10, 10))
        assert np.isfinite(spread).all()
        assert (spread >= SPREAD_BOUNDS[0]).all()
        assert (spread <= SPREAD_BOUNDS[1]).all()


def small_table() -> NoiseTable:
    weights = np.zeros(len(SHARED))
    weights[SHARED.index("doubt")] = math.log(2)
    curl = np.zeros(21)
    curl[8] = 1.0
    return NoiseTable(np.full(21, math.log(0.04)), curl, weights, np.linspace(1, 9, 9))


def test_a_table_multiplies_the_spread_by_each_feature() -> None:
    found = Features(np.zeros((21, len(SHARED))), np.zeros(21))
    np.testing.assert_allclose(small_table().spread(found), 0.04)
    found.shared[:, SHARED.index("doubt")] = -3
    # Three powers of ten less absence, half each: an eighth.
    np.testing.assert_allclose(small_table().spread(found), 0.005)
    found.curl[8] = 0.5
    assert small_table().spread(found)[8] == pytest.approx(0.005 * math.exp(0.5))
    assert small_table().spread(found)[7] == pytest.approx(0.005)


def test_sigma_adds_the_shared_error_in_squares() -> None:
    # The table's gain of two copies is 3: 3/224 and 4/224 make 5/224.
    sigma = small_table().sigma(np.full(21, 4 / 3 / 224), 2)
    np.testing.assert_allclose(sigma, 5 / 224)


def test_spreads_are_combined_by_their_geometric_mean() -> None:
    expected, measured = np.full(21, 0.02), np.full(21, 0.005)
    np.testing.assert_allclose(combined_spread(expected, measured), 0.01)
    # Copies that agree by chance do not make a landmark exact.
    np.testing.assert_allclose(
        combined_spread(expected, np.zeros(21)), math.sqrt(0.02 * SPREAD_BOUNDS[0])
    )


class MovedHands:
    """A network whose every reading is the hand moved by (1, −1) px times the number of calls."""

    def __init__(self) -> None:
        self.regions: list[Region] = []

    def __call__(self, image: np.ndarray, region: Region) -> HandReading:
        self.regions.append(region)
        hand = flat_hand()
        return replace(hand, landmarks_2d=hand.landmarks_2d + np.array([1, -1]) * len(self.regions))


IMAGE = np.zeros((400, 400, 3), dtype=np.uint8)


def test_without_copies_the_landmarks_stay_and_the_network_rests() -> None:
    network, noise = MovedHands(), LandmarkNoise()
    found = noise(network, IMAGE, flat_hand())
    assert network.regions == []
    np.testing.assert_array_equal(found.landmarks_2d, flat_hand().landmarks_2d)
    assert found.sigma is not None
    side = region_of_landmarks(flat_hand().landmarks_2d).side
    expected = noise.table.sigma(noise.table.spread(features(flat_hand(), 400, 400)), 0)
    np.testing.assert_allclose(found.sigma, side * expected)


def test_with_copies_landmarks_are_the_mean_and_sigma_has_both_sources() -> None:
    network, noise = MovedHands(), LandmarkNoise(copies=2)
    found = noise(network, IMAGE, flat_hand())
    assert len(network.regions) == 2
    # The mean of 0, 1 and 2 steps.
    np.testing.assert_allclose(found.landmarks_2d, flat_hand().landmarks_2d + np.array([1, -1]))
    side = region_of_landmarks(flat_hand().landmarks_2d).side
    # Squared distances 2 and 8 px², halved for a coordinate: a mean of 2.5.
    table = noise.table.spread(features(flat_hand(), 400, 400))
    expected = side * noise.table.sigma(np.sqrt(table * math.sqrt(2.5) / side), 2)
    assert found.sigma is not None
    np.testing.assert_allclose(found.sigma, expected)


@pytest.mark.parametrize("copies", [-1, len(COPIES) + 1])
def test_a_number_of_copies_that_there_is_not_is_refused(copies: int) -> None:
    words = f"Expected detector.copies from 0 \\(none\\) to 8, found {copies}."
    with pytest.raises(ValueError, match=words):
        LandmarkNoise(copies)
    with pytest.raises(ValueError, match=words):
        MediaPipeDetector(copies=copies)


def test_the_shipped_table_has_a_gain_for_every_number_of_copies() -> None:
    table = load_table()
    assert table.gain.shape == (len(COPIES) + 1,)
    # More copies: a mean that is nearer, and a spread that is better known.
    assert (table.gain > 1).all()
    assert table.gain[8] < table.gain[1]


def test_the_table_gives_more_noise_to_doubt_tips_and_edges() -> None:
    table = load_table()

    def spread(reading: HandReading) -> np.ndarray:
        return table.spread(features(reading, 400, 400))

    calm = replace(flat_hand(), presence=0.9999)
    assert (spread(replace(calm, presence=0.6)) > 1.5 * spread(calm)).all()
    points = calm.landmarks_3d.copy()
    points[11] = points[10] + [0, 0, -0.02]
    points[12] = points[11] + np.array([0, 0.02, -0.02])
    bent = replace(calm, landmarks_3d=points)
    assert (spread(bent)[11:13] > 1.1 * spread(calm)[11:13]).all()
    moved = replace(calm, landmarks_2d=calm.landmarks_2d + np.array([0, 150]))
    assert spread(moved)[0] > 1.1 * spread(calm)[0]


def test_photographs_have_sigma_in_pixels_of_the_image(
    models: Path, two_hands: np.ndarray, one_hand: np.ndarray
) -> None:
    detector = MediaPipeDetector(models=models)
    for image in (two_hands, one_hand):
        for hand in detector(image).hands:
            assert hand.sigma is not None
            extent = np.ptp(hand.landmarks_2d, axis=0).max()
            assert 0.003 < (hand.sigma / extent).min() <= (hand.sigma / extent).max() < 0.2
    large = np.repeat(np.repeat(one_hand, 3, axis=0), 3, axis=1)
    (small_hand,), (large_hand,) = detector(one_hand).hands, detector(large).hands
    assert small_hand.sigma is not None
    assert large_hand.sigma is not None
    assert np.median(large_hand.sigma / small_hand.sigma) == pytest.approx(3, rel=0.25)


def test_copies_change_landmarks_by_less_than_three_sigma(
    models: Path, one_hand: np.ndarray
) -> None:
    (alone,) = WholeImageDetector(models=models)(one_hand).hands
    (mean,) = WholeImageDetector(models=models, copies=4)(one_hand).hands
    assert alone.sigma is not None
    assert mean.sigma is not None
    moved = np.linalg.norm(mean.landmarks_2d - alone.landmarks_2d, axis=1)
    assert moved.max() > 0.01
    assert (moved < 3 * alone.sigma).all()


def test_blurred_hands_have_more_noise(models: Path, one_hand: np.ndarray) -> None:
    blurred = np.asarray(cv2.GaussianBlur(one_hand, (0, 0), 4), dtype=np.uint8)
    detector = WholeImageDetector(models=models, copies=3, min_presence=0)
    (sharp_hand,), (blurred_hand,) = detector(one_hand).hands, detector(blurred).hands
    assert sharp_hand.sigma is not None
    assert blurred_hand.sigma is not None
    assert np.median(blurred_hand.sigma) > np.median(sharp_hand.sigma)


def test_the_table_ranks_landmarks_of_photographs_as_copies_do(models: Path) -> None:
    material = os.environ.get("HAND_RECON_MATERIAL")
    if not material:
        pytest.skip("needs photographs: $HAND_RECON_MATERIAL/pictures")
    from landmark_noise.clip import rank_correlation
    from landmark_noise.readings import read_hands

    folder = Path(material) / "pictures"
    rows = json.loads((folder / "test.json").read_text())
    names = [row["image"] for row in rows if row["image"].startswith(("digits/", "rps/"))]
    hands = [one for one in read_hands(read(folder / name) for name in names[::16]) if one]
    assert len(hands) > 25
    table = load_table()
    expected = np.array([table.spread(hand.features) for hand in hands])
    measured = np.array([hand.spread(len(COPIES)) for hand in hands])
    assert rank_correlation(expected, measured) > 0.6
