import numpy as np
import pytest
import torch

from hand_recon.hand.landmark_order import FEWEST, better_order, bone_sums
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import LANDMARK_ORDERS, landmark_permutation
from tests.support.views import known_hands, views

ORDERS = sorted(LANDMARK_ORDERS)


@pytest.fixture(scope="module", params=["space", "image"])
def points(request: pytest.FixtureRequest, hand: HandModel) -> np.ndarray:
    """Forty hands in FreiHAND's order."""
    torch.manual_seed(3)
    batch = views(hand, known_hands(hand, 40))
    assert batch.landmarks_3d is not None
    found = batch.landmarks_3d if request.param == "space" else batch.landmarks_2d
    return np.asarray(found.double().numpy())


@pytest.mark.parametrize("order", ORDERS)
def test_every_order_is_detected_from_the_points(points: np.ndarray, order: str) -> None:
    written = points[:, landmark_permutation("freihand", order)]
    sums = bone_sums(written)
    assert min(sums, key=lambda name: float(sums[name].mean())) == order
    expected = None if order == "freihand" else order
    assert better_order(written) == expected


@pytest.mark.parametrize("order", ORDERS)
def test_the_correct_order_is_not_reported(points: np.ndarray, order: str) -> None:
    written = points[:, landmark_permutation("freihand", order)]
    assert better_order(written, order) is None


def test_detector_noise_is_not_reported(points: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    size = np.linalg.norm(np.ptp(points, axis=1), axis=-1)[:, None, None]
    for share in (0.02, 0.05, 0.1):
        assert better_order(points + share * size * rng.normal(size=points.shape)) is None


def test_the_sum_is_that_of_the_bones_over_the_hand() -> None:
    # All landmarks on one line, one apart, in the order of the bones of a chain: FreiHAND's landmarks
    # 0-4 are one chain; the other four fingers start at the wrist again.
    line = np.arange(21.0)[None, :, None] * np.array([1.0, 0.0, 0.0])
    bones = sum(1 for child in range(1, 21) if child % 4 != 1) + (1 + 5 + 9 + 13 + 17)
    assert bone_sums(line)["freihand"].tolist() == pytest.approx([bones / 20])


def test_too_few_complete_hands_give_no_result(points: np.ndarray) -> None:
    written = points[:, landmark_permutation("freihand", "rhd")].copy()
    written[FEWEST - 1 :, 3] = np.nan
    assert better_order(written) is None
    assert better_order(points[:, landmark_permutation("freihand", "rhd")]) == "rhd"


def test_a_minority_of_hands_does_not_change_the_result(points: np.ndarray) -> None:
    # Two thirds of the hands are reversed: shorter on average in that order, but not for a third of them.
    written = points[:, landmark_permutation("freihand", "rhd")].copy()
    written[::3] = points[::3]
    sums = bone_sums(written)
    assert sums["rhd"].mean() < sums["freihand"].mean()
    assert better_order(written) is None
