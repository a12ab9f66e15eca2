"""Pages of labelled hands: landmarks where they belong, marks written, pages of at most 24."""

from pathlib import Path

import cv2
import numpy as np

from hand_recon.data.images import read_image
from hand_recon.hand.skeleton import TIPS
from hand_recon.runs.labelling.label_files import Pair
from hand_recon.runs.labelling.label_records import LabelledHand
from hand_recon.runs.labelling.label_sheets import draw_sheets, labelled_crop
from hand_recon.visualization.overlay import FINGER_COLOURS
from tests.support.labelled_hands import MARKS, SIZE, image, labelled


def test_the_crop_shows_the_pixels_around_the_landmarks() -> None:
    """The middle of the hand's box lies on the edge between two pixels, at which the colour changes."""
    pixels = np.zeros((300, 400, 3), dtype=np.uint8)
    pixels[:, 120:, 0], pixels[80:, :, 1] = 200, 100
    points = np.tile(np.array([120.0, 80.0]), (21, 1))
    points[0], points[20] = (100, 70), (140, 90)
    # 1.7 × 40 px become 680, ten for each.
    shown = labelled_crop(pixels, LabelledHand(points, "right"), 680)
    # The colour changes in the middle, within the width of the interpolation.
    assert [shown[20, x, 0] for x in (20, 334, 345, 660)] == [0, 0, 200, 200]
    assert [shown[y, 20, 1] for y in (20, 334, 345, 660)] == [0, 0, 100, 100]
    # The tip of the little finger is drawn 200 px to the right of the middle, and 100 below.
    assert shown[440, 540].tolist() == list(FINGER_COLOURS[4])
    assert shown[440, 570].tolist() == [200, 100, 0]


def test_outside_of_the_image_is_grey_and_fingers_have_their_colours() -> None:
    pixels = np.full((100, 100, 3), 30, dtype=np.uint8)
    points = np.random.default_rng(0).uniform(5, 95, (21, 2))
    points[[*TIPS]] = [(10, 10), (30, 90), (50, 10), (70, 90), (90, 10)]
    shown = labelled_crop(pixels, LabelledHand(points, "left"), 170)
    assert (shown[0, 0] == 128).all()
    for colour in FINGER_COLOURS:
        assert (np.abs(shown.astype(int) - colour).sum(axis=-1) < 12).sum() > 3


def photographed(root: Path, count: int, doubtful: int) -> list[Pair]:
    """Hands in images on the disk, the first ones doubtful."""
    root.mkdir()
    pairs = []
    for number in range(count):
        cv2.imwrite(str(root / f"{number}.png"), np.full((SIZE[1], SIZE[0], 3), 200, np.uint8))
        hand = labelled(number, doubtful=number < doubtful)
        pairs.append((image(f"{number}.png", hand), hand))
    return pairs


def test_pages_have_24_hands_and_those_without_an_image_are_left_out(tmp_path: Path) -> None:
    pairs = photographed(tmp_path / "photos", 28, 2)
    (tmp_path / "photos" / "27.png").unlink()
    pages = draw_sheets(tmp_path / "sheets", tmp_path / "photos", pairs, 100)
    assert [page.name for page in pages] == ["sure_1.png", "sure_2.png", "doubtful_1.png"]
    sizes = [read(page).shape for page in pages]
    # 24 in four rows of six; one; two in a row.
    assert sizes[0][0] > 3.9 * sizes[1][0]
    assert sizes[0][1] == 6 * 256
    assert sizes[2][1] == 2 * 256


def test_marks_are_written_in_red_on_doubtful_hands_alone(tmp_path: Path) -> None:
    pairs = photographed(tmp_path / "photos", 2, 1)
    sure, doubtful = draw_sheets(tmp_path / "sheets", tmp_path / "photos", pairs, 10)
    assert MARKS
    assert red(read(doubtful)) > 50
    assert red(read(sure)) == 0


def test_no_more_hands_than_asked_for_are_drawn_and_none_makes_no_folder(tmp_path: Path) -> None:
    pairs = photographed(tmp_path / "photos", 9, 0)
    (page,) = draw_sheets(tmp_path / "sheets", tmp_path / "photos", pairs, 3)
    assert read(page).shape[1] == 3 * 256
    assert draw_sheets(tmp_path / "none", tmp_path / "photos", [], 3) == []
    assert not (tmp_path / "none").exists()


def read(path: Path) -> np.ndarray:
    page = read_image(path)
    assert page is not None
    return page


def red(page: np.ndarray) -> int:
    channels = page.astype(int)
    return int(((channels[..., 0] > 180) & (channels[..., 1:] < 60).all(axis=-1)).sum())
