"""Marks of doubtful hands: each by a number worked out by hand, on both sides of its limit."""

import numpy as np
import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.runs.labelling.marks import (
    FIT,
    LOW_SCORE,
    OUTSIDE,
    SEVERAL,
    SIDE,
    UNCERTAIN,
    Limits,
    marks_of_detection,
    marks_of_fit,
)
from tests.support.exact_hands import exact, with_points
from tests.support.labelled_hands import detected, square

SIZE = (300, 200)


def names(*hands: object) -> list[set[str]]:
    found = marks_of_detection(hands, SIZE, Limits())  # type: ignore[arg-type]
    return [set(marks) for marks in found]


def test_a_clear_hand_has_no_mark() -> None:
    assert names(detected(square())) == [set()]


def test_scores_below_their_limits_are_marked_and_those_at_the_limits_are_not() -> None:
    assert names(detected(square(), score=0.9, side_score=0.8)) == [set()]
    assert names(detected(square(), score=0.89)) == [{LOW_SCORE}]
    assert names(detected(square(), side_score=0.79)) == [{SIDE}]


def test_every_hand_of_an_image_with_several_is_marked() -> None:
    assert names(detected(square()), detected(square(80, 150, 60))) == [{SEVERAL}, {SEVERAL}]
    (marks, _) = marks_of_detection([detected(square())] * 2, SIZE, Limits())
    assert "has 2 hands" in marks[SEVERAL]


@pytest.mark.parametrize(
    ("left", "top"), [(-11.0, 50.0), (50.0, -11.0), (211.0, 50.0), (50.0, 111.0)]
)
def test_a_landmark_far_outside_on_any_edge_is_marked(left: float, top: float) -> None:
    (marks,) = marks_of_detection([detected(square(100, left, top))], SIZE, Limits())
    assert set(marks) == {OUTSIDE}
    assert "11 % of the hand's extent outside" in marks[OUTSIDE]
    assert names(detected(square(100, 50, 109))) == [set()]


def test_sigma_is_compared_with_the_extent_and_not_with_pixels() -> None:
    assert names(detected(square(100), sigma=5.1)) == [{UNCERTAIN}]
    assert names(detected(square(100), sigma=4.9)) == [set()]
    assert names(detected(square(140), sigma=5.1)) == [set()]
    assert names(detected(square(100), sigma=None)) == [set()]


def test_the_median_sigma_counts_so_that_one_uncertain_fingertip_is_no_mark() -> None:
    hand = detected(square(100))
    assert hand.sigma is not None
    hand.sigma[4] = 90.0
    assert names(hand) == [set()]


def test_missing_landmarks_and_unknown_scores_are_no_marks() -> None:
    points = square()
    points[3] = np.nan
    hand = detected(points)
    assert hand.sigma is not None
    hand.sigma[3] = np.nan
    assert names(hand) == [set()]
    assert names(detected(square(), sigma=np.nan)) == [set()]


def test_the_fit_of_a_possible_hand_has_no_mark_and_exchanged_fingers_have_some(
    hand: HandModel,
) -> None:
    good = exact(hand)
    assert marks_of_fit(good) == [{}] * len(good)
    order = [0, *range(1, 5), *range(17, 21), *range(9, 17), *range(5, 9)]
    found = marks_of_fit(with_points(good, good.observed.landmarks_2d[:, order]))
    assert all(found)
    assert {name.removeprefix(FIT) for marks in found for name in marks} >= {"mean residual"}
    assert all(name.startswith(FIT) for marks in found for name in marks)


def test_a_fit_without_a_finite_result_is_marked(hand: HandModel) -> None:
    good = exact(hand)
    good.prediction.landmarks_3d[1] = torch.nan
    found = marks_of_fit(good)
    assert set(found[1]) == {f"{FIT}no result"}
    assert not found[0]


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [("min_score", 1.1, "from 0 to 1"), ("min_side_score", -0.1, "from 0 to 1"),
     ("max_sigma", -1.0, "of at least 0"), ("max_outside", float("nan"), "of at least 0")],
)  # fmt: skip
def test_limits_out_of_their_range_are_refused(option: str, value: float, expected: str) -> None:
    with pytest.raises(ValueError, match=rf"Expected limits\.{option} {expected}"):
        Limits(**{option: value})
