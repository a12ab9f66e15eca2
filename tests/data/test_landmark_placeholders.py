"""Coordinates that stand for "not found" are missing landmarks, and a known order is recognised."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.parsed import Assumptions
from hand_recon.data.landmarks.placeholders import at_placeholders
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import landmark_permutation
from tests.support.landmark_writing import POINTS, SCORES, assert_same_hands, written
from tests.support.predicted_hands import true_hands

PAIRS = [(0, 0), (-1, -1), (0.0, -0.0)]


def with_pair(pair: tuple[float, float], *places: tuple[int, int]) -> np.ndarray:
    points = POINTS.copy()
    for hand, landmark in places:
        points[hand, landmark] = pair
    return points


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("places", [[(1, 4)], [(0, 8), (0, 17), (2, 0)]])
def test_placeholders_are_read_like_null_and_counted(
    tmp_path: Path,
    pair: tuple[float, float],
    places: list[tuple[int, int]],
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.INFO):
        landmarks = read_landmarks(written(tmp_path, with_pair(pair, *places).tolist()))
    assert_same_hands(landmarks, with_pair((np.nan, np.nan), *places))
    hands = len({hand for hand, _ in places})
    assert f"{len(places)} landmarks of {hands} hands are exactly at" in caplog.text
    assert "set placeholders=keep to use them" in caplog.text


def test_placeholders_can_be_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    points = with_pair((0, 0), (1, 4))
    path = written(tmp_path, points.tolist())
    with caplog.at_level(logging.INFO):
        assert_same_hands(read_landmarks(path, assumed=Assumptions(placeholders="keep")), points)
    assert "exactly at" not in caplog.text
    with pytest.raises(ValueError, match="Unknown placeholders 'drop'; choose one of"):
        Assumptions(placeholders="drop")


@pytest.mark.parametrize("near", [(0.0, 0.5), (1e-9, 0.0), (-1.0, 0.0), (1.0, 1.0)])
def test_other_coordinates_near_the_corner_are_labels(
    tmp_path: Path, near: tuple[float, float]
) -> None:
    points = with_pair(near, (1, 4))
    assert_same_hands(read_landmarks(written(tmp_path, points.tolist())), points)


@pytest.mark.parametrize(
    ("third", "missing"), [(0.0, True), (-1.0, True), (0.4, False), (None, True)]
)
def test_a_score_says_if_the_landmark_was_found(
    tmp_path: Path, third: float | None, missing: bool
) -> None:
    hands: list[Any] = np.concatenate([POINTS, SCORES[..., None]], axis=-1).tolist()
    hands[1][4] = [0.0, 0.0, third]
    labelled = read_landmarks(written(tmp_path, hands)).labelled
    expected = [[1, 4]] if missing else []
    assert (~labelled).nonzero().tolist() == expected


@pytest.mark.parametrize("pair", PAIRS)
def test_placeholders_among_shares_of_the_image_are_missing_too(
    tmp_path: Path, pair: tuple[float, float]
) -> None:
    hands: list[Any] = np.concatenate([POINTS / 2000, SCORES[..., None]], axis=-1).tolist()
    hands[1][4] = [*pair, pair[0]]
    landmarks = read_landmarks(written(tmp_path, hands), image_size=(2000, 2000))
    assert (~landmarks.labelled).nonzero().tolist() == [[1, 4]]
    np.testing.assert_allclose(landmarks.landmarks_2d[0].numpy(), POINTS[0])
    assert landmarks.confidence is not None
    assert landmarks.confidence[0].tolist() == SCORES[0].tolist()


def test_a_sigma_at_the_corner_is_no_score(tmp_path: Path) -> None:
    hands = np.concatenate([with_pair((0, 0), (1, 4)), 3 + SCORES[..., None]], axis=-1).tolist()
    landmarks = read_landmarks(written(tmp_path, hands))
    assert (~landmarks.labelled).nonzero().tolist() == [[1, 4]]
    assert landmarks.sigma is not None
    assert landmarks.sigma[1, 4].isnan()


def test_a_hand_of_placeholders_alone_was_not_found(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[1] = -1
    assert read_landmarks(written(tmp_path, points.tolist())).usable.tolist() == [True, False, True]


def test_coordinates_relative_to_the_wrist_are_kept(tmp_path: Path) -> None:
    points = POINTS - POINTS[:, :1]
    points[..., 1] = -np.abs(points[..., 1])
    assert (points[:, 0] == 0).all()
    assert_same_hands(read_landmarks(written(tmp_path, points.tolist())), points)


def small_hand() -> np.ndarray:
    """Points of one hand in whole pixels, 40 wide, some of which coincide."""
    points = np.random.default_rng(0).integers(300, 341, (1, 21, 2)).astype(float)
    points[0, 3] = points[0, 4] = points[0, 5]
    return points


@pytest.mark.parametrize("pair", [(1.0, 1.0), (-100.0, -100.0), (639.0, 479.0), (0.5, 0.5)])
def test_a_repeated_pair_far_from_the_hand_is_a_placeholder(pair: tuple[float, float]) -> None:
    points = small_hand()
    assert not at_placeholders(points).any()
    points[0, [8, 12]] = pair
    assert at_placeholders(points).nonzero()[1].tolist() == [8, 12]
    # Once alone it may be an outlier, and near the hand a coincidence.
    points[0, 12] = points[0, 11]
    assert not at_placeholders(points).any()


def test_missing_landmarks_are_no_placeholders() -> None:
    points = small_hand()
    points[0, 4:] = np.nan
    assert not at_placeholders(points).any()
    assert not at_placeholders(np.full((2, 21, 2), np.nan)).any()


# --- order --------------------------------------------------------------------------------------


def hands_in(order: str, hand: HandModel, count: int = 8) -> list[Any]:
    """Possible hands, projected with a focal length of 600 px, in an order of landmarks."""
    shown = true_hands(hand, count, seed=2).landmarks
    pixels = 600 * shown[..., :2] / shown[..., 2:] + torch.tensor([320.0, 240.0])
    listed: list[Any] = pixels[:, list(landmark_permutation("freihand", order))].tolist()
    return listed


@pytest.mark.parametrize("order", ["interhand", "rhd", "ho3d"])
def test_another_order_is_named_and_nothing_is_reordered(
    tmp_path: Path, hand: HandModel, order: str, caplog: pytest.LogCaptureFixture
) -> None:
    points = hands_in(order, hand)
    landmarks = read_landmarks(written(tmp_path, points))
    assert f"look to be in the order of '{order}' and not of 'freihand'" in caplog.text
    assert f"set order={order}" in caplog.text
    np.testing.assert_array_equal(landmarks.landmarks_2d.numpy(), np.array(points))
    caplog.clear()
    read_landmarks(tmp_path / "landmarks.json", assumed=Assumptions(order=order))
    assert "look to be in the order" not in caplog.text


def test_a_wrong_option_is_named_too(
    tmp_path: Path, hand: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path, hands_in("freihand", hand))
    read_landmarks(path)
    assert "look to be in the order" not in caplog.text
    read_landmarks(path, assumed=Assumptions(order="interhand"))
    assert "in the order of 'freihand' and not of 'interhand'" in caplog.text


def test_four_hands_and_random_points_are_too_little_evidence(
    tmp_path: Path, hand: HandModel, caplog: pytest.LogCaptureFixture
) -> None:
    read_landmarks(written(tmp_path, hands_in("interhand", hand, 4)))
    for seed in range(20):
        random = np.random.default_rng(seed).uniform(0, 500, (6, 21, 2))
        (tmp_path / "random.json").write_text(json.dumps(random.tolist()))
        read_landmarks(tmp_path / "random.json")
    assert "look to be in the order" not in caplog.text
