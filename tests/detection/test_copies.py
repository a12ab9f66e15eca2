"""Copies of a hand's crop: equal landmarks of a network without error, and the spread of others."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.copies import COPIES, Copy, read_copies, spread_of_copies
from hand_recon.detection.hands import HandReading, LandmarkNetwork
from hand_recon.detection.regions import Region, region_of_landmarks


def test_the_first_copy_is_the_square_itself() -> None:
    square = Region(30, 40, 50, 0.6)
    assert COPIES[0].of(square) == square


def test_a_copy_moves_by_shares_of_the_side_and_rotates_by_degrees() -> None:
    changed = Copy(90, 1.5, 0.1, -0.2, mirrored=True).of(Region(30, 40, 50, 0.5))
    assert (changed.x, changed.y, changed.side) == pytest.approx((35, 30, 75))
    assert changed.rotation == pytest.approx(0.5 + math.pi / 2)
    assert changed.mirrored


def test_all_copies_differ_and_half_of_the_last_six_are_mirrored() -> None:
    assert len(set(COPIES)) == len(COPIES) == 8
    assert sum(copy.mirrored for copy in COPIES[2:]) == 3


class Marks:
    """A network that finds 21 discs by their grey values."""

    input_size = 224

    def __call__(self, crop: np.ndarray) -> tuple[np.ndarray, ...]:
        places = np.zeros((21, 3), dtype=np.float32)
        for index in range(21):
            ys, xs = np.nonzero(np.abs(crop[..., 0].astype(int) - 50 - 9 * index) <= 2)
            places[index, :2] = (np.median(xs), np.median(ys))
        return (
            places.reshape(63),
            np.ones(1, dtype=np.float32),
            np.array([0.8], dtype=np.float32),
            np.tile(np.array([0.01, 0.02, 0.03], dtype=np.float32), 21),
        )


def marked() -> tuple[np.ndarray, np.ndarray]:
    """An image of 21 discs of different grey, and their centres."""
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2)[:21]
    centres = (400 + 40 * grid + rng.integers(-6, 7, (21, 2))).astype(int)
    image = np.zeros((1000, 1000, 3), dtype=np.uint8)
    for index, (x, y) in enumerate(centres.tolist()):
        cv2.circle(image, (x, y), 15, (50 + 9 * index,) * 3, -1)
    return image, centres.astype(float)


def network() -> LandmarkNetwork:
    found = LandmarkNetwork(lambda: b"")
    vars(found)["network"] = Marks()
    return found


def test_without_error_every_copy_gives_the_same_landmarks() -> None:
    image, centres = marked()
    reading = HandReading(centres, np.zeros((21, 3)), 0.9, 0.9)
    copies = read_copies(network(), image, reading, len(COPIES))
    assert copies.shape == (8, 21, 2)
    # A pixel of the crop is 1.5 to 2.5 pixels of the image.
    assert np.abs(copies - centres).max() < 4
    assert np.abs(copies - centres).mean() < 1
    assert read_copies(network(), image, reading, 0).shape == (0, 21, 2)


def test_a_mirrored_crop_gives_the_side_and_the_metres_of_the_image() -> None:
    image, centres = marked()
    square = region_of_landmarks(centres)
    plain = network()(image, Region(square.x, square.y, square.side))
    mirrored = network()(image, Region(square.x, square.y, square.side, mirrored=True))
    assert plain.right == pytest.approx(0.8)
    assert mirrored.right == pytest.approx(0.2)
    np.testing.assert_allclose(plain.landmarks_3d[0], [0.01, 0.02, 0.03], rtol=1e-6)
    np.testing.assert_allclose(mirrored.landmarks_3d[0], [-0.01, 0.02, 0.03], rtol=1e-6)
    assert np.abs(mirrored.landmarks_2d - centres).max() < 4


@given(st.floats(-3, 3), st.booleans(), st.floats(10, 300))
def test_mirroring_twice_is_no_change(rotation: float, mirrored: bool, side: float) -> None:
    region = Region(70, 50, side, rotation, mirrored)
    affine = region.crop_to_image(224)
    # Columns are perpendicular and of the pixel's length; a mirrored square has a negative determinant.
    pixel = side / 224
    np.testing.assert_allclose(
        affine[:, :2].T @ affine[:, :2], pixel**2 * np.eye(2), atol=1e-9 * side
    )
    assert np.sign(np.linalg.det(affine[:, :2])) == (-1 if mirrored else 1)
    # The crop's centre is the square's.
    np.testing.assert_allclose(affine @ [112, 112, 1], [70, 50], atol=1e-9)
    other = Region(70, 50, side, rotation, not mirrored).crop_to_image(224)
    np.testing.assert_allclose(affine @ [224 - 30, 9, 1], other @ [30, 9, 1], atol=1e-9)


def test_spread_is_the_root_mean_square_of_a_coordinate() -> None:
    landmarks = np.zeros((21, 2))
    copies = np.zeros((2, 21, 2))
    copies[0, 4], copies[1, 4] = (3, 4), (0, -5)
    # Squared distances 25 and 25, halved for a coordinate: 12.5.
    expected = np.zeros(21)
    expected[4] = math.sqrt(12.5)
    np.testing.assert_allclose(spread_of_copies(landmarks, copies), expected)


def test_spread_of_noise_is_its_standard_deviation() -> None:
    noise = np.random.default_rng(0).normal(scale=2.5, size=(4000, 21, 2))
    np.testing.assert_allclose(spread_of_copies(np.zeros((21, 2)), noise), 2.5, rtol=0.05)
