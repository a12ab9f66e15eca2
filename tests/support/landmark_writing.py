"""Random landmarks of three hands, and functions that write them as JSON, CSV and COCO."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from hand_recon.data.landmarks.image_landmarks import ImageLandmarks

POINTS = np.random.default_rng(0).uniform(5, 1900, (3, 21, 2)).round(2)
SCORES = np.random.default_rng(1).uniform(0.1, 1, (3, 21)).round(3)
CAMERA = [[900.0, 0.0, 640.0], [0.0, 905.0, 480.0], [0.0, 0.0, 1.0]]


def written(folder: Path, content: Any, name: str = "landmarks.json") -> Path:  # noqa: ANN401
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def with_scores(points: np.ndarray = POINTS, third_value: np.ndarray = SCORES) -> list[Any]:
    hands: list[Any] = np.concatenate([points, third_value[..., None]], axis=-1).tolist()
    return hands


def table(folder: Path, rows: list[list[Any]], delimiter: str = ",") -> Path:
    with (folder / "landmarks.csv").open("w", newline="") as stream:
        csv.writer(stream, delimiter=delimiter).writerows(rows)
    return folder / "landmarks.csv"


def assert_same_hands(landmarks: ImageLandmarks, points: np.ndarray = POINTS) -> None:
    np.testing.assert_array_equal(landmarks.landmarks_2d.numpy(), points)
    assert (landmarks.labelled.numpy() == np.isfinite(points).all(axis=-1)).all()


def coco_hand(points: np.ndarray, visibility: np.ndarray) -> list[float]:
    numbers: list[float] = np.concatenate([points, visibility[:, None]], axis=1).ravel().tolist()
    return numbers
