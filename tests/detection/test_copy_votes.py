"""Side and presence of a hand by its copies."""

from dataclasses import fields

import numpy as np
import pytest

from hand_recon.detection.copy_votes import CopyVotes
from hand_recon.detection.hands import HandReading
from hand_recon.detection.landmark_noise import LandmarkNoise
from hand_recon.detection.regions import Region

IMAGE = np.zeros((200, 200, 3), dtype=np.uint8)


class Answers:
    """A network whose answers are given, one for each call, with landmarks that differ a little."""

    def __init__(self, right: list[float], presence: list[float]) -> None:
        self.right, self.presence, self.calls = right, presence, 0

    def __call__(self, image: np.ndarray, region: Region) -> HandReading:
        answer = reading(self.right[self.calls], self.presence[self.calls], self.calls + 1)
        self.calls += 1
        return answer


def reading(right: float, presence: float, seed: int = 0) -> HandReading:
    points = np.random.default_rng(0).uniform(50, 150, (21, 2))
    return HandReading(
        points + seed, np.random.default_rng(1).normal(size=(21, 3)), presence, right
    )


def test_side_and_presence_are_means_over_all_readings() -> None:
    first = reading(right=0.9, presence=1.0)
    found = CopyVotes(2)(Answers([0.2, 0.1], [0.7, 0.4]), IMAGE, first)
    assert found.right == pytest.approx(0.4)
    assert found.side == "left"
    assert found.side_score == pytest.approx(0.6)
    assert found.presence == pytest.approx(0.7)


def test_landmarks_and_sigma_are_those_of_landmark_noise() -> None:
    first = reading(right=0.9, presence=0.95)
    answers = ([0.9, 0.8, 0.7], [0.9, 0.8, 0.9])
    found = CopyVotes(3)(Answers(*answers), IMAGE, first)
    plain = LandmarkNoise(3)(Answers(*answers), IMAGE, first)
    np.testing.assert_array_equal(found.landmarks_2d, plain.landmarks_2d)
    assert found.sigma is not None
    assert plain.sigma is not None
    np.testing.assert_array_equal(found.sigma, plain.sigma)
    # The mean of offsets 0, 1, 2 and 3.
    np.testing.assert_allclose(found.landmarks_2d - first.landmarks_2d, 1.5)


def test_without_copies_nothing_is_read_again() -> None:
    first = reading(right=0.9, presence=0.95)
    found = CopyVotes(0)(Answers([], []), IMAGE, first)
    plain = LandmarkNoise(0)(Answers([], []), IMAGE, first)
    assert found.sigma is not None
    assert plain.sigma is not None
    np.testing.assert_array_equal(found.sigma, plain.sigma)
    for field in fields(first):
        if field.name != "sigma":
            np.testing.assert_array_equal(getattr(found, field.name), getattr(first, field.name))
