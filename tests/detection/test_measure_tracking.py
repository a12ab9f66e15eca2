"""The table of ways to find a clip's hands: jitter by hand, and a row of made-up hands."""

import numpy as np
import pytest

from hand_recon.detection.detector import Detections
from measure_tracking import Way, first_hands, jitter
from tests.support.moving_hands import FRAME, detected, open_hand


def test_jitter_is_the_distance_from_the_neighbours_mean() -> None:
    landmarks = np.zeros((5, 21, 2))
    landmarks[2] = [3, 4]
    # 5 px at the middle frame, 2.5 px at both neighbours: √((6.25 + 25 + 6.25) / 3).
    assert jitter(landmarks) == pytest.approx(np.sqrt(12.5))
    steady = np.arange(5.0)[:, None, None] * np.ones((1, 21, 2))
    assert jitter(steady) == pytest.approx(0)


def test_a_row_says_hands_tracks_and_distance() -> None:
    clip = [(), *[(detected(open_hand() + 200),)] * 9]
    frames = iter(clip)
    way = Way("made up", lambda image: Detections(next(frames)))
    for number in range(10):
        way.add(number, 0.04 * number, FRAME)
    row = way.row(np.tile(open_hand() + np.array([203, 204]), (10, 1, 1)))
    assert "0 in 1, 1 in 9 frames" in row
    assert "right 9" in row
    assert "jitter 0.00 px" in row
    assert "distance 5.00 px" in row
    assert np.isnan(first_hands(way.frames)[0]).all()
    assert "distance" not in way.row(None)
