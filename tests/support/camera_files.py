"""Landmarks read together with a camera file."""

from pathlib import Path
from typing import Any

import numpy as np

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from tests.support.landmark_writing import written

MATRIX = [[800.0, 0.0, 330.0], [0.0, 810.0, 235.0], [0.0, 0.0, 1.0]]
"""Intrinsics of an image of 640 × 480 pixels."""

POINTS = np.random.default_rng(3).uniform([100, 80], [540, 400], (2, 21, 2)).round(2)
"""Landmarks of two hands in it, pixels."""


def given_camera(
    tmp_path: Path,
    text: str,
    points: np.ndarray = POINTS,
    **hand: Any,  # noqa: ANN401
) -> ImageLandmarks:
    """Right hands, or `hand`'s side, read with a camera file of the given text."""
    hands = [{"landmarks": some.tolist(), "side": "right", **hand} for some in points]
    (tmp_path / "K").write_text(text)
    return read_landmarks(written(tmp_path, hands), tmp_path / "K")
