"""Marks on photographs: at their pixels, in proportion to the hand, and without harm far outside."""

import numpy as np
import pytest

from hand_recon.visualization.hand_marks import (
    Place,
    draw_given,
    draw_label,
    draw_skeleton,
    draw_two_sigma,
    hand_size,
    line_width,
    text_strip,
)
from hand_recon.visualization.overlay import FINGER_COLOURS

INDEX_TIP, WRIST, THUMB_CMC = 8, 0, 1


def grey(height: int = 80, width: int = 100) -> np.ndarray:
    return np.full((height, width, 3), 128, dtype=np.uint8)


def only(index: int, point: tuple[float, float]) -> np.ndarray:
    landmarks = np.full((21, 2), np.nan)
    landmarks[index] = point
    return landmarks


def changed(image: np.ndarray) -> np.ndarray:
    return (image != 128).any(axis=-1)


def test_a_landmark_is_a_dot_of_its_colour_at_its_pixel() -> None:
    image = grey()
    draw_skeleton(image, only(INDEX_TIP, (20.5, 40.5)), 2)
    assert tuple(image[40, 20]) == FINGER_COLOURS[1]
    rows, columns = np.nonzero(changed(image))
    assert abs(rows.mean() - 40) < 0.5
    assert abs(columns.mean() - 20) < 0.5


def test_lines_grow_by_the_width_that_is_asked_for() -> None:
    landmarks = only(WRIST, (10.5, 40.5))
    landmarks[THUMB_CMC] = 90.5, 40.5

    def across(width: int) -> float:
        """Darkness across the middle of the bone, in pixels of the thumb's colour."""
        image = grey()
        draw_skeleton(image, landmarks, width)
        return float(((128 - image[:, 50, 0].astype(float)) / (128 - FINGER_COLOURS[0][0])).sum())

    # OpenCV's anti-aliased lines are about two pixels wider than asked for, at every width above one.
    assert 1 <= across(1) <= 3
    assert abs(across(9) - across(3) - 6) < 0.2


def test_the_width_of_lines_is_in_proportion_to_the_hand() -> None:
    assert [line_width(size) for size in (0.0, 100.0, 240.0, 2400.0)] == [1, 1, 2, 20]
    points = np.array([[np.nan, 3.0], [10.0, 20.0], [40.0, 100.0], [np.inf, 0.0]])
    assert hand_size(points) == 80
    assert hand_size(np.full((4, 2), np.nan)) == 0


def test_a_given_landmark_is_a_ring_with_a_line_to_the_fitted_one() -> None:
    image = grey()
    draw_given(image, only(INDEX_TIP, (20.5, 40.5)), only(INDEX_TIP, (80.5, 40.5)), 4)
    seen = changed(image)
    # The ring has a radius of 10 pixels; the line starts at its middle.
    assert seen[40, 10]
    assert seen[30, 20]
    assert not seen[36, 18]
    assert seen[40, 50]
    assert not seen[40, 85:].any()


def test_missing_points_leave_no_mark() -> None:
    image, nothing = grey(), np.full((21, 2), np.nan)
    draw_skeleton(image, nothing, 2)
    draw_given(image, nothing, np.full((21, 2), 40.0), 2)
    draw_two_sigma(image, nothing, np.broadcast_to(np.eye(2), (21, 2, 2)), 2)
    draw_two_sigma(image, np.full((21, 2), 40.0), np.full((21, 2, 2), np.nan), 2)
    assert not changed(image).any()


def test_the_ellipse_reaches_two_sigma_along_each_axis() -> None:
    image = grey(200, 200)
    covariance = np.broadcast_to(np.diag([30.0**2, 10.0**2]), (21, 2, 2))
    draw_two_sigma(image, only(INDEX_TIP, (100.5, 100.5)), covariance, 2)
    rows, columns = np.nonzero(changed(image))
    assert abs(np.ptp(columns) - 2 * 60) <= 3
    assert abs(np.ptp(rows) - 2 * 20) <= 3
    assert abs(columns.mean() - 100) < 0.6
    # The inside is tinted, so that what is below stays visible.
    assert 0 < np.abs(image[100, 100].astype(int) - 128).max() < 60


def test_a_correlation_tilts_the_ellipse_as_v_grows_with_u() -> None:
    image = grey(200, 200)
    covariance = np.broadcast_to(np.array([[400.0, 350.0], [350.0, 400.0]]), (21, 2, 2))
    draw_two_sigma(image, only(INDEX_TIP, (100.5, 100.5)), covariance, 2)
    rows, columns = np.nonzero(changed(image))
    assert np.corrcoef(rows, columns)[0, 1] > 0.7


@pytest.mark.parametrize("place", [(-20.0, 40.0), (40.0, -15.0), (120.0, 95.0)])
def test_an_ellipse_across_the_edge_is_cut_there(place: tuple[float, float]) -> None:
    covariance = np.broadcast_to(np.diag([900.0, 400.0]), (21, 2, 2))
    cut, whole = grey(), grey(280, 300)
    draw_two_sigma(cut, only(INDEX_TIP, place), covariance, 2)
    draw_two_sigma(whole, only(INDEX_TIP, (place[0] + 100, place[1] + 100)), covariance, 2)
    # Clipping moves an anti-aliased edge by less than a pixel.
    assert np.abs(cut.astype(int) - whole[100:180, 100:200]).mean() < 0.3
    assert changed(cut).any()


@pytest.mark.parametrize("far", [1e4, 1e9, -1e9])
@pytest.mark.parametrize("size", [(1, 1), (2, 90), (80, 100)])
def test_points_far_outside_and_huge_ellipses_do_no_harm(far: float, size: tuple[int, int]) -> None:
    image, landmarks = grey(*size), np.full((21, 2), far)
    landmarks[WRIST] = 0.5, 0.5
    draw_skeleton(image, landmarks, 2)
    draw_given(image, landmarks, landmarks[::-1].copy(), 2)
    draw_two_sigma(image, landmarks, np.broadcast_to(np.eye(2) * far**2, (21, 2, 2)), 2)
    assert changed(image)[0, 0]


def test_a_label_is_above_the_hand_or_below_it_at_the_top() -> None:
    middle, top = grey(300, 300), grey(300, 300)
    draw_label(middle, "1", np.array([[100.0, 100], [200, 200]]), warning=False)
    rows, columns = np.nonzero(changed(middle))
    assert rows.max() < 100
    assert columns.min() == 100
    taken = [Place(0, 0, 300, 99)]
    draw_label(top, "1", np.array([[100.0, 100], [200, 200]]), taken, warning=False)
    assert np.nonzero(changed(top))[0].min() >= 200


def test_a_label_does_not_cover_a_hand_that_reaches_from_top_to_bottom() -> None:
    image = grey(300, 300)
    place = draw_label(image, "1", np.array([[100.0, 2], [200, 298]]), warning=False)
    assert place.left >= 200
    # At the right edge it goes to the left.
    place = draw_label(image, "1", np.array([[100.0, 2], [299, 298]]), warning=False)
    assert place.left + place.columns <= 100


def test_labels_of_hands_at_one_place_do_not_cover_each_other() -> None:
    image, box = grey(400, 400), np.array([[150.0, 150], [250, 250]])
    taken: list[Place] = []
    for name in "123456":
        taken.append(draw_label(image, name, box, taken, warning=False))
    # A few pixels of the letters' edges may have the grey of the image.
    assert changed(image).sum() > 0.98 * sum(place.rows * place.columns for place in taken)


def test_places_that_touch_do_not_overlap_and_those_that_share_a_pixel_do() -> None:
    place = Place(10, 20, 5, 4)
    for left, top, shares in (
        (15, 20, False),
        (14, 20, True),
        (10, 24, False),
        (6, 17, True),
        (5, 16, False),
    ):
        other = Place(left, top, 5, 4)
        assert place.overlaps(other) == other.overlaps(place) == shares


def test_a_warning_is_yellow_and_other_labels_are_dark() -> None:
    assert text_strip("1, left", 20)[0, 0].tolist() == [40, 40, 40]
    assert text_strip("1, left", 20, warning=True)[0, 0].tolist() == [255, 200, 40]


@pytest.mark.parametrize("text", ["1, right", "é 手 🖐", " ", "a" * 500])
def test_any_text_is_drawn_in_its_height(text: str) -> None:
    strip = text_strip(text, 20)
    assert strip.shape[0] < 60
    image = grey(10, 10)
    draw_label(image, text, np.array([[2.0, 2], [8, 8]]), warning=True)
    assert image.shape == (10, 10, 3)
