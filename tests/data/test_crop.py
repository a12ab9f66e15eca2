import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.data.crop import (
    CropPolicy,
    HandRegion,
    Square,
    around_box,
    around_landmarks,
    crop_image,
    crop_intrinsics,
    crop_matrix,
    crop_mirror,
    crop_points,
    mask_box,
    whole_image,
)

squares = st.builds(
    Square,
    centre=st.tuples(st.floats(-100, 500), st.floats(-100, 500)),
    side=st.floats(10, 1000),
)


@given(squares, st.integers(16, 512), st.floats(-math.pi, math.pi))
def test_the_inverse_matrix_undoes_the_crop(square: Square, size: int, rotation: float) -> None:
    points = np.random.default_rng(0).uniform(-50, 600, (21, 2))
    matrix = crop_matrix(square, size, rotation)
    back = crop_points(crop_points(points, matrix), np.linalg.inv(matrix))
    assert np.abs(back - points).max() < 1e-3


@given(squares, st.integers(16, 512), st.floats(-math.pi, math.pi))
def test_the_cropped_camera_projects_to_the_cropped_labels(
    square: Square, size: int, rotation: float
) -> None:
    intrinsics = np.array([[500.0, 0, 120], [0, 480, 100], [0, 0, 1]])
    point = np.array([0.05, -0.02, 0.6])
    matrix = crop_matrix(square, size, rotation)
    seen = crop_intrinsics(intrinsics, matrix) @ point
    expected = crop_points((intrinsics @ point / 0.6)[:2], matrix)
    np.testing.assert_allclose(seen[:2] / seen[2], expected, atol=1e-6)


def test_the_corners_of_a_square_are_the_corners_of_its_crop() -> None:
    matrix = crop_matrix(Square(centre=(100, 60), side=40), 96)
    corners = crop_points(np.array([[80.0, 40], [120, 80], [100, 60]]), matrix)
    np.testing.assert_allclose(corners, [[0, 0], [96, 96], [48, 48]], atol=1e-12)


def test_a_quarter_turn_takes_right_to_down() -> None:
    matrix = crop_matrix(Square(centre=(50, 50), side=100), 100, math.pi / 2)
    np.testing.assert_allclose(crop_points(np.array([70.0, 50]), matrix), [50, 70], atol=1e-12)


@pytest.mark.parametrize("size", [40, 96, 224, 300])
@pytest.mark.parametrize("rotation", [0.0, 0.4])
@pytest.mark.parametrize("side", [150.0, 224.0])
def test_a_drawn_dot_ends_where_its_label_ends(size: int, rotation: float, side: float) -> None:
    image = np.zeros((224, 224, 3), dtype=np.uint8)
    # Pixels 100 … 107 and 120 … 127 cover [100, 108) and [120, 128).
    image[120:128, 100:108] = 255
    matrix = crop_matrix(Square(centre=(112, 112), side=side), size, rotation)
    crop = crop_image(image, matrix, size)[..., 0].astype(float)
    rows, columns = np.indices(crop.shape) + 0.5
    centroid = np.array([(columns * crop).sum(), (rows * crop).sum()]) / crop.sum()
    assert np.abs(centroid - crop_points(np.array([104.0, 124.0]), matrix)).max() < 0.05


def test_shrinking_averages_thin_stripes_instead_of_dropping_them() -> None:
    image = np.zeros((224, 224, 3), dtype=np.uint8)
    image[:, ::4] = 255
    for side in (224.0, 112.0):
        crop = crop_image(image, crop_matrix(Square((112, 112), side), 28), 28)
        assert np.abs(crop.astype(float) - 255 / 4).max() < 2


def test_a_whole_square_image_at_its_own_size_is_itself() -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    matrix = crop_matrix(whole_image(64, 64), 64)
    np.testing.assert_array_equal(crop_image(image, matrix, 64), image)


def test_outside_the_image_is_black() -> None:
    image = np.full((50, 50, 3), 200, dtype=np.uint8)
    crop = crop_image(image, crop_matrix(Square(centre=(0, 0), side=50), 50), 50)
    assert crop[:24].max() == 0
    assert crop[26:, 26:].min() == 200


def test_a_wide_image_is_padded_above_and_below() -> None:
    image = np.full((40, 80, 3), 200, dtype=np.uint8)
    crop = crop_image(
        image, CropPolicy(size=80).matrix((40, 80), HandRegion(np.zeros((21, 2)))), 80
    )
    assert crop[:19].max() == 0
    assert crop[21:59].min() == 200
    assert crop[61:].max() == 0


def test_the_box_around_landmarks_leaves_missing_ones_out() -> None:
    landmarks = np.array([[10.0, 20], [30, 30], [np.nan, np.nan]])
    square = around_landmarks(landmarks, expansion=1.5)
    assert square == Square(centre=(20, 25), side=30)
    assert around_box((10, 20, 30, 30), 1.5) == square


def test_a_crop_around_one_landmark_is_refused() -> None:
    with pytest.raises(ValueError, match="found 1; use crop=full"):
        around_landmarks(np.array([[10.0, 20], [np.nan, np.nan]]))


def test_a_crop_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match=r"positive side, found centre .* and side 0"):
        around_landmarks(np.array([[10.0, 20], [10, 20]]))


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(ValueError, match="Unknown crop 'hand'; choose one of"):
        CropPolicy(around="hand")


def test_a_box_and_a_mask_are_what_a_crop_is_made_around() -> None:
    mask = np.zeros((60, 100), dtype=bool)
    mask[10:30, 20:60] = True
    # A speck of noise, as JPEG masks have them, does not widen the box.
    mask[55, 95] = True
    assert mask_box(mask) == (20.0, 10.0, 60.0, 30.0)
    region = HandRegion(np.full((21, 2), np.nan), np.array([20.0, 10.0, 60.0, 30.0]), mask)
    expected = crop_matrix(Square((40.0, 20.0), 60.0), 50)
    for around in ("box", "mask"):
        found = CropPolicy(50, around, expansion=1.5).matrix((60, 100), region)
        np.testing.assert_allclose(found, expected)


def test_a_crop_of_the_middle_has_the_side_asked_for() -> None:
    matrix = CropPolicy(65, "centre", centre_side=130.0).matrix(
        (224, 224), HandRegion(np.zeros((21, 2)))
    )
    corners = crop_points(np.array([[47.0, 47.0], [177.0, 177.0]]), matrix)
    np.testing.assert_allclose(corners, [[0, 0], [65, 65]])


@pytest.mark.parametrize("around", ["box", "mask"])
def test_what_a_dataset_does_not_know_cannot_be_cropped_around(around: str) -> None:
    region = HandRegion(
        np.zeros((21, 2)), np.full(4, np.nan), np.zeros((4, 4), dtype=bool), "a.jpg"
    )
    with pytest.raises(ValueError, match=rf"a.jpg has .*{around}.*data.crop.around=joints"):
        CropPolicy(64, around).matrix((4, 4), region)


def test_a_mirrored_crop_mirrored_again_is_the_crop() -> None:
    mirror = crop_mirror(96)
    np.testing.assert_array_equal(mirror @ mirror, np.eye(3))
    np.testing.assert_array_equal(crop_points(np.array([[1.5, 7.0]]), mirror), [[94.5, 7.0]])


def test_a_region_far_beyond_the_image_takes_bounded_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    image = np.full((60, 80, 3), 200, np.uint8)
    sides: list[int] = []
    warp = cv2.warpAffine

    def noted(content: Any, matrix: Any, size: tuple[int, int], **options: Any) -> Any:  # noqa: ANN401
        # More would take gigabytes.
        assert size[0] < 20_000
        sides.append(size[0])
        return warp(content, matrix, size, **options)

    monkeypatch.setattr(cv2, "warpAffine", noted)
    for side in (1e5, 1e200):
        crop = crop_image(image, crop_matrix(Square((40, 30), side), 10), 10)
        assert crop.shape == (10, 10, 3)
    # Four times the image's longer side; within that, every pixel is sampled.
    assert sides == [320, 320]
    crop = crop_image(image, crop_matrix(Square((40, 30), 200), 10), 10)
    assert sides[2] == 200
    # The crop's 20 × 20 pixels of the image are averaged: the image covers 60 × 80 of 200 × 200.
    assert crop.sum() == pytest.approx(3 * 200 * 60 * 80 / 20**2, rel=0.01)
