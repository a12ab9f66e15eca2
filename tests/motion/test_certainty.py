"""Certainty of a pose as one number."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_recon.fitting.second_order.minima import FIXED_SIGMA
from hand_recon.motion.certainty import BOUNDS, TYPICAL, certainty_of
from hand_recon.motion.estimates import ROTATION

TYPICAL_INFORMATION = np.exp(TYPICAL) * np.eye(51)


def test_a_typical_hand_has_certainty_one() -> None:
    assert certainty_of(TYPICAL_INFORMATION) == pytest.approx(1.0)


def test_twice_the_standard_deviation_is_a_quarter_of_the_certainty() -> None:
    assert certainty_of(TYPICAL_INFORMATION / 4) == pytest.approx(0.25)


def test_certainty_is_the_geometric_mean_over_coordinates() -> None:
    information = np.diag(np.exp(TYPICAL) * np.r_[np.full(17, 8.0), np.ones(34)])
    assert certainty_of(information) == pytest.approx(2.0)


def test_angles_without_a_range_do_not_count() -> None:
    information = TYPICAL_INFORMATION / 4
    fixed = [2, 4, 5, 44]
    information[fixed, fixed] = FIXED_SIGMA**-2
    assert certainty_of(information) == pytest.approx(0.25)


def test_a_rotation_of_the_cameras_axes_changes_nothing() -> None:
    random = np.random.default_rng(0)
    root = random.normal(size=(51, 80))
    information = root @ root.T * 10
    turn = np.eye(51)
    turn[ROTATION, ROTATION] = Rotation.random(random_state=random).as_matrix()
    assert certainty_of(turn @ information @ turn.T) == pytest.approx(
        float(certainty_of(information))
    )


def test_batches_are_hands_side_by_side() -> None:
    several = np.stack([TYPICAL_INFORMATION, TYPICAL_INFORMATION / 4, TYPICAL_INFORMATION * 4])
    np.testing.assert_allclose(certainty_of(several.reshape(3, 1, 51, 51))[:, 0], [1.0, 0.25, 4.0])


@pytest.mark.parametrize(
    "information", [np.full((51, 51), np.nan), np.zeros((51, 51)), -np.eye(51)]
)
def test_without_information_certainty_is_the_least(information: np.ndarray) -> None:
    assert certainty_of(information) == BOUNDS[0]
