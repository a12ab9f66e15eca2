"""Overlays: landmarks where they are, and nothing for what is missing."""

import numpy as np

from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandPrediction
from hand_recon.visualization.overlay import COLUMNS, FINGER_COLOURS, draw_landmarks, rows

GREY = np.full((64, 64, 3), 128, dtype=np.uint8)


def test_a_landmark_is_drawn_in_its_fingers_colour_at_its_pixel() -> None:
    landmarks = np.full((21, 2), np.nan)
    landmarks[8] = 20.5, 40.5
    drawn = draw_landmarks(GREY, landmarks)
    assert tuple(drawn[40, 20]) == FINGER_COLOURS[1]
    rows_changed, columns_changed = np.nonzero((drawn != GREY).any(axis=-1))
    assert abs(columns_changed.mean() - 20) < 0.5
    assert abs(rows_changed.mean() - 40) < 0.5


def test_missing_landmarks_leave_no_mark() -> None:
    assert (draw_landmarks(GREY, np.full((21, 2), np.nan)) == GREY).all()


def test_landmarks_far_outside_do_no_harm() -> None:
    landmarks = np.full((21, 2), 1e9)
    landmarks[0] = 32, 32
    assert draw_landmarks(GREY, landmarks).shape == GREY.shape


def test_the_image_that_is_drawn_on_is_not_changed() -> None:
    before = GREY.copy()
    draw_landmarks(GREY, np.full((21, 2), 30.0))
    assert (before == GREY).all()


def test_a_row_has_its_panels_and_the_mesh_covers_the_landmarks(
    hand: HandModel, scene: tuple[HandBatch, HandPrediction]
) -> None:
    batch, prediction = scene
    drawn_rows = rows(batch, prediction, hand.faces, panel=64)
    assert len(drawn_rows) == 2
    assert drawn_rows[0].shape == (64, 64 * len(COLUMNS), 3)
    mesh_panel = drawn_rows[0][:, 128:192]
    knuckle = prediction.landmarks_2d[0, 9].round().int()
    assert (mesh_panel[knuckle[1], knuckle[0]] != 128).any()
    # Unlabelled landmarks are not drawn as labels, though predicted ones are.
    drawn = [(row[:, :128] != 128).any(axis=-1).sum() for row in drawn_rows]
    assert drawn[1] < drawn[0]
