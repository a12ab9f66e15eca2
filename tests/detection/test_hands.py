"""Landmarks of one hand: from the crop to the image, directions that are tried, hands found twice."""

import dataclasses
import math

import numpy as np
import pytest

from hand_recon.detection.hands import (
    HandReading,
    LandmarkNetwork,
    is_false_twin,
    is_repeated,
    is_same_hand,
)
from hand_recon.detection.regions import Region


class FakeHands:
    """A landmark network that knows which crops it was given, and is certain of one of them."""

    input_size = 224

    def __init__(self, *, certain: int = 0, presence: float = 0.999, right: float = 0.9) -> None:
        self.calls = 0
        self.certain, self.presence, self.right = certain, presence, right

    def __call__(self, crop: np.ndarray) -> tuple[np.ndarray, ...]:
        assert crop.shape == (224, 224, 3)
        screen = np.zeros((21, 3), dtype=np.float32)
        screen[:, 0] = 112 + np.linspace(0, 56, 21)
        screen[:, 1] = 168 - 8 * np.arange(21)
        world = np.zeros((21, 3), dtype=np.float32)
        world[:] = [0.03, -0.08, 0.02]
        presence = self.presence if self.calls >= self.certain else 0.4 + 0.01 * self.calls
        self.calls += 1
        return (
            screen.reshape(63),
            np.array([presence], dtype=np.float32),
            np.array([self.right], dtype=np.float32),
            world.reshape(63),
        )


def network(fake: FakeHands) -> LandmarkNetwork:
    found = LandmarkNetwork(lambda: b"")
    vars(found)["network"] = fake
    return found


IMAGE = np.zeros((300, 400, 3), dtype=np.uint8)


def test_landmarks_come_back_in_pixels_of_the_image() -> None:
    reading = network(FakeHands())(IMAGE, Region(x=200, y=100, side=448))
    # (112, 168) of 224 is half a crop right and three quarters down: the centre, and 112 px below it.
    np.testing.assert_allclose(reading.landmarks_2d[0], [200, 212])
    np.testing.assert_allclose(reading.landmarks_2d[20], [200 + 112, 212 - 320], rtol=1e-6)
    np.testing.assert_allclose(reading.landmarks_3d[7], [0.03, -0.08, 0.02], rtol=1e-6)


def test_a_rotated_square_rotates_landmarks_and_metres_alike() -> None:
    region = Region(x=200, y=100, side=448, rotation=math.pi / 2)
    reading = network(FakeHands())(IMAGE, region)
    # Down in the crop is left in the image.
    np.testing.assert_allclose(reading.landmarks_2d[0], [200 - 112, 100], rtol=1e-6)
    np.testing.assert_allclose(reading.landmarks_3d[7], [0.08, 0.03, 0.02], rtol=1e-6)


def test_the_side_is_the_more_probable_one_and_its_score_is_at_least_a_half() -> None:
    right = network(FakeHands(right=0.8))(IMAGE, Region(0, 0, 100))
    assert right.side == "right"
    assert right.side_score == pytest.approx(0.8)
    left = network(FakeHands(right=0.3))(IMAGE, Region(0, 0, 100))
    assert left.side == "left"
    assert left.side_score == pytest.approx(0.7)


def test_a_certain_hand_is_read_twice() -> None:
    fake = FakeHands()
    assert network(fake).read_box(IMAGE, Region(200, 100, 100)).presence == pytest.approx(0.999)
    assert fake.calls == 2


def test_other_directions_are_tried_until_one_is_certain() -> None:
    fake = FakeHands(certain=5)
    assert network(fake).read_box(IMAGE, Region(200, 100, 100)).presence == pytest.approx(0.999)
    # Two looks each in three directions.
    assert fake.calls == 6


def test_without_a_certain_direction_the_highest_presence_counts() -> None:
    fake = FakeHands(certain=100)
    reading = network(fake).read_box(IMAGE, Region(200, 100, 100))
    assert fake.calls == 8
    assert reading.presence == pytest.approx(0.47)


def reading(landmarks: np.ndarray) -> HandReading:
    return HandReading(landmarks.astype(float), np.zeros((21, 3)), 0.9, 0.9)


def spread_hand() -> np.ndarray:
    """Landmarks of a hand of size 100: its palm's triangle is at (0, 0), (0, 100) and (60, 80)."""
    landmarks = np.stack([np.linspace(-20, 80, 21), np.linspace(0, 160, 21)], axis=1)
    landmarks[[0, 5, 17]] = [[0, 0], [0, 100], [60, 80]]
    return landmarks


@pytest.mark.parametrize(("near", "same"), [(9, False), (10, True), (21, True)])
def test_ten_landmarks_within_a_fifth_of_the_palm_make_one_hand(near: int, same: bool) -> None:
    other = spread_hand() + np.array([19.9, 0])
    other[near:] += [10, 0]
    # The triangle's corners move at most 10 px, so that a fifth of its size stays below 22 px.
    assert is_same_hand(reading(spread_hand()), reading(other)) is same


def test_hands_that_do_not_overlap_are_two() -> None:
    # Points on a short line inside a large triangle: near each other, but the boxes hardly overlap.
    flat = np.zeros((21, 2))
    flat[:, 0] = np.linspace(0, 10, 21)
    flat[[0, 5, 17]] = np.array([[0, 0], [5, 0.1], [10, 0]])
    # Boxes 0.1 high, d apart, share (0.1 − d) / (0.1 + d): a quarter at 0.06, a seventh at 0.075.
    assert is_same_hand(reading(flat), reading(flat + np.array([0, 0.06])))
    assert not is_same_hand(reading(flat), reading(flat + np.array([0, 0.075])))


def test_landmarks_farther_than_a_fifth_of_the_palm_are_of_two_hands() -> None:
    assert is_same_hand(reading(spread_hand()), reading(spread_hand() + np.array([19.5, 0])))
    assert not is_same_hand(reading(spread_hand()), reading(spread_hand() + np.array([20.5, 0])))


def test_the_larger_hand_sets_the_distance() -> None:
    small = 0.6 * spread_hand() + np.array([12, 32])
    distances = np.linalg.norm(small - spread_hand(), axis=1)
    assert (distances < 20).sum() >= 10 > (distances < 12).sum()
    assert is_same_hand(reading(small), reading(spread_hand()))
    assert is_same_hand(reading(spread_hand()), reading(small))


def test_a_hand_is_repeated_if_any_earlier_one_is_the_same() -> None:
    far = reading(spread_hand() + 1000)
    assert not is_repeated(reading(spread_hand()), [])
    assert not is_repeated(reading(spread_hand()), [far])
    assert is_repeated(reading(spread_hand()), [far, reading(spread_hand() + 1)])


@pytest.mark.parametrize(
    ("presence", "away", "twin"),
    [
        (0.80, 55.9, True),  # Below 0.35 of the extent, 160.
        (0.80, 56.1, False),
        (0.949, 40.0, True),
        (0.951, 40.0, False),  # As sure as a hand that is there.
    ],
)
def test_a_worse_reading_over_a_hand_is_its_false_twin(
    presence: float, away: float, twin: bool
) -> None:
    good = dataclasses.replace(reading(spread_hand()), presence=0.99)
    shifted = spread_hand() + np.array([away, 0])
    other = dataclasses.replace(reading(shifted), presence=presence, right=0.1)
    assert is_false_twin(other, good) is twin
    assert not is_false_twin(good, other)


def test_readings_beside_each_other_are_no_twins() -> None:
    # Boxes of 95 × 160 that share 5 columns: 800 / 29,600 is below a tenth.
    good = dataclasses.replace(reading(spread_hand()), presence=0.99)
    flat = reading(spread_hand() * [0.1, 1] + [80, 0])
    assert not is_false_twin(dataclasses.replace(flat, presence=0.5), good)


def test_extent_is_the_longer_side_of_the_landmarks_box() -> None:
    assert reading(spread_hand()).extent == pytest.approx(160)
    np.testing.assert_allclose(reading(spread_hand()).box, [-15, 0, 80, 160])
