"""Rotated squares: numbers worked out by hand, a slow twin, and what moves with the hand."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hand_recon.detection.regions import (
    Region,
    region_of_image,
    region_of_landmarks,
    region_of_palm,
    upright_rotation,
)
from tests.support.bilinear import sampled


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    """A smooth random image: sampling differences stay below a grey level."""
    small = np.random.default_rng(seed).integers(0, 256, (height // 8 + 2, width // 8 + 2, 3))
    return np.asarray(
        cv2.resize(small.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR)
    )


def mapped(region: Region, size: int, *point: float) -> list[float]:
    return (region.crop_to_image(size) @ [*point, 1.0]).tolist()


def test_corners_and_centre_of_an_upright_square() -> None:
    region = Region(x=10, y=20, side=8)
    assert mapped(region, 4, 0, 0) == pytest.approx([6, 16])
    assert mapped(region, 4, 4, 4) == pytest.approx([14, 24])
    assert mapped(region, 4, 2, 2) == pytest.approx([10, 20])
    # One pixel of the crop is two of the image.
    assert mapped(region, 4, 1, 0) == pytest.approx([8, 16])


def test_a_quarter_rotation_turns_the_upper_edge_to_the_right() -> None:
    region = Region(x=10, y=20, side=8, rotation=math.pi / 2)
    assert mapped(region, 4, 2, 0) == pytest.approx([14, 20])
    assert mapped(region, 4, 0, 0) == pytest.approx([14, 16])


def test_the_whole_of_a_square_image_is_its_own_crop() -> None:
    image = noise(32, 32)
    np.testing.assert_array_equal(region_of_image(32, 32).crop(image, 32), image)


@pytest.mark.parametrize(
    "region", [Region(30, 20, 25, 0.4), Region(5, 50, 60, -2.5), Region(40, 30, 200, 3.0)]
)
def test_crops_are_those_of_bilinear_sampling_written_out(region: Region) -> None:
    image = noise(56, 72)
    crop = region.crop(image, 24).astype(float)
    exact = np.abs(crop - sampled(image, region, 24)).max()
    # Versions of OpenCV before 5 round sample points to a 32nd of a pixel.
    rounded = np.abs(crop - sampled(image, region, 24, steps=32)).max()
    assert min(exact, rounded) <= 1.01


def test_sampling_is_not_smoothed_when_it_shrinks() -> None:
    stripes = np.zeros((64, 64, 3), dtype=np.uint8)
    stripes[:, ::8] = 255
    # Every 8th pixel is met exactly; an average over 8 would be 32.
    assert (region_of_image(64, 64).crop(stripes, 8) == 255).all()


@pytest.mark.parametrize(("height", "width"), [(30, 47), (47, 30), (40, 40)])
@pytest.mark.parametrize("padding", [1.2, 1.7, 2.5])
def test_padding_is_what_a_padded_copy_gives(height: int, width: int, padding: float) -> None:
    image = noise(height, width)
    side = int(padding * max(height, width))
    left, top = (side - width) // 2, (side - height) // 2
    copy = cv2.copyMakeBorder(
        image, top, side - height - top, left, side - width - left, cv2.BORDER_REPLICATE
    )
    direct = region_of_image(height, width, padding).crop(image, 64)
    via_copy = region_of_image(side, side).crop(np.asarray(copy), 64)
    assert np.abs(direct.astype(int) - via_copy.astype(int)).max() <= 1


def test_the_letterbox_is_centred_and_black() -> None:
    white = np.full((20, 40, 3), 255, dtype=np.uint8)
    crop = region_of_image(20, 40).crop(white, 40, cv2.BORDER_CONSTANT)
    assert (crop[:9] == 0).all()
    assert (crop[11:29] == 255).all()
    assert (crop[31:] == 0).all()


def test_square_of_an_upright_palm() -> None:
    # The palm is 20 × 40 px about (20, 40): half its height up, 2.6 of its longer side.
    region = region_of_palm(
        np.array([10.0, 20, 30, 60]), np.array([20.0, 60]), np.array([20.0, 20])
    )
    assert (region.x, region.y) == pytest.approx((20, 20))
    assert region.side == pytest.approx(104)
    assert region.rotation == pytest.approx(0)


def test_square_of_a_palm_that_points_right() -> None:
    # Half of the box's height (10), towards the fingers; the longer side is 40.
    region = region_of_palm(
        np.array([20.0, 30, 60, 50]), np.array([20.0, 40]), np.array([60.0, 40])
    )
    assert (region.x, region.y) == pytest.approx((50, 40))
    assert region.side == pytest.approx(104)
    assert region.rotation == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("direction", "rotation"),
    [((0, -1), 0.0), ((1, 0), math.pi / 2), ((-1, 0), -math.pi / 2), ((0, 1), -math.pi)],
)
def test_rotation_that_makes_fingers_point_up(
    direction: tuple[float, float], rotation: float
) -> None:
    wrist = np.array([3.0, 5.0])
    assert upright_rotation(wrist, wrist + direction) == pytest.approx(rotation)


def test_the_angle_is_not_that_of_the_tasks_api() -> None:
    # 90 radians in place of 90 degrees would turn the crop by 26.6 degrees.
    wrong = math.remainder(90 - math.pi / 2, 2 * math.pi)
    assert math.degrees(wrong) == pytest.approx(26.6, abs=0.05)
    assert upright_rotation(np.array([0.0, 9.0]), np.array([0.0, 0.0])) == pytest.approx(0)


def upright_hand() -> np.ndarray:
    """Landmarks whose box of stable landmarks is 40 wide and 80 high, the fingers up."""
    landmarks = np.zeros((21, 2))
    landmarks[[0, 5, 9, 13, 17]] = [[0, 0], [-20, -60], [0, -60], [0, -60], [20, -60]]
    landmarks[[6, 10, 14, 18]] = [[-20, -80], [0, -80], [0, -80], [20, -80]]
    landmarks[13, 0] = 20
    landmarks[[4, 8, 12, 16, 20]] = [500, 500]
    return landmarks


def test_square_of_landmarks() -> None:
    # Wrist to (MCP of index + ring) / 4 + middle / 2 = (0, −60): upright. The box is x −20…20, y −80…0, its
    # centre (0, −40) moves up by a tenth of 80; the side is twice 80. Tips are not used.
    region = region_of_landmarks(upright_hand())
    assert (region.x, region.y) == pytest.approx((0, -48))
    assert region.side == pytest.approx(160)
    assert region.rotation == pytest.approx(0)


@given(
    angle=st.floats(-math.pi, math.pi),
    scale=st.floats(0.1, 20),
    x=st.floats(-300, 300),
    y=st.floats(-300, 300),
)
def test_the_square_moves_grows_and_rotates_with_the_landmarks(
    angle: float, scale: float, x: float, y: float
) -> None:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved = scale * upright_hand() @ turn.T + [x, y]
    before, after = region_of_landmarks(upright_hand()), region_of_landmarks(moved)
    expected = scale * turn @ [before.x, before.y] + [x, y]
    assert [after.x, after.y] == pytest.approx(expected.tolist(), abs=1e-6 * scale + 1e-9)
    assert after.side == pytest.approx(scale * before.side)
    assert math.remainder(after.rotation - angle, 2 * math.pi) == pytest.approx(0, abs=1e-9)
    assert -math.pi <= after.rotation < math.pi
