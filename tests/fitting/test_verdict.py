"""Verdicts: good hands are plausible on both sides, mistakes are doubtful at any size and in whole fits."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_recon.data.landmarks.files import read_landmarks
from hand_recon.data.landmarks.image_landmarks import ImageLandmarks
from hand_recon.fitting.descent import Descent, fit
from hand_recon.fitting.fitted_hands import FittedHands
from hand_recon.fitting.in_parts import fit_part
from hand_recon.fitting.objective import Objective
from hand_recon.fitting.observation import observed
from hand_recon.fitting.verdict import DOUBTFUL, NOT_FITTED, PLAUSIBLE, Verdict, verdicts
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.hand.skeleton import landmark_permutation
from hand_recon.knowledge.prior import Prior
from hand_recon.uncertainty import NegativeLogLikelihood, SquaredError, Staged
from tests.support.exact_hands import (
    CAMERA,
    COUNT,
    SIZE,
    exact,
    judge,
    parameters,
    with_camera,
    with_points,
)


@pytest.mark.parametrize("left", [False, True])
def test_exact_hands_are_plausible_on_both_sides(hand: HandModel, left: bool) -> None:
    hands = exact(hand, left=left)
    assert judge(hands) == [Verdict(PLAUSIBLE)] * COUNT
    assert verdicts(hands) == [Verdict(PLAUSIBLE)] * COUNT
    uncalibrated = replace(hands, observed=replace(hands.observed, intrinsics=None))
    assert judge(uncalibrated) == [Verdict(PLAUSIBLE)] * COUNT


def test_no_hands_have_no_verdicts(hand: HandModel) -> None:
    none = exact(hand, parameters(1))
    empty = replace(
        none,
        observed=none.observed.select(slice(0, 0)),
        prediction=none.prediction.select(slice(0, 0)),
        origins=none.origins[:0],
        scale=none.scale[:0],
    )
    assert verdicts(empty) == []
    assert verdicts(empty, []) == []


def test_another_number_of_image_sizes_is_refused(hand: HandModel) -> None:
    with pytest.raises(ValueError, match=r"Found 1 image sizes for 4 hands; expected one for each"):
        verdicts(exact(hand), [SIZE])


def test_every_reason_is_one_sentence_with_a_limit_and_a_remedy(hand: HandModel) -> None:
    scrambled = exact(hand)
    scrambled = with_points(scrambled, scrambled.observed.landmarks_2d.flip(1))
    wrong = with_camera(scrambled, CAMERA / CAMERA.new_tensor([[640.0], [480], [1]]))
    found = [reason for verdict in judge(wrong) for reason in verdict.reasons]
    assert len(found) >= 3 * COUNT
    for reason in found:
        assert reason[0].isupper()
        assert reason.endswith(".")
        assert ": " in reason


def test_hands_without_a_result_say_why(hand: HandModel) -> None:
    hands = exact(hand)
    points, labelled = hands.observed.landmarks_2d.clone(), hands.observed.labelled.clone()
    labelled[0, 3:] = False
    points[1] = 100.0
    lost = hands.prediction.landmarks_3d.clone()
    lost[2, 5] = torch.nan
    broken = replace(
        hands,
        observed=replace(hands.observed, landmarks_2d=points, labelled=labelled),
        prediction=replace(hands.prediction, landmarks_3d=lost),
    )
    found = judge(broken)
    assert [verdict.value for verdict in found] == [NOT_FITTED] * 3 + [PLAUSIBLE]
    assert found[0].reasons[0].startswith("3 landmarks are given, and a fit needs 4 or more")
    assert found[1].reasons[0].startswith("All 21 given landmarks are one point")
    assert found[2].reasons[0].startswith("The fitted numbers are not finite")
    assert all(len(verdict.reasons) <= 1 for verdict in found)


def test_results_of_nan_alone_have_one_verdict_each(hand: HandModel) -> None:
    hands = exact(hand)
    nothing = hands.prediction.select(slice(None))
    nothing = nothing._map(lambda tensor: torch.full_like(tensor, torch.nan))
    found = judge(replace(hands, prediction=nothing))
    assert {verdict.value for verdict in found} == {NOT_FITTED}


@settings(max_examples=10)
@given(scale=st.floats(0.3, 30.0))
def test_verdicts_do_not_depend_on_the_resolution_of_the_image(scale: float) -> None:
    hands = exact(open_hand())
    points = hands.observed.landmarks_2d.clone()
    # A different mistake in every hand.
    points[0, 4] += 60.0
    points[1] = points[1].flip(0)
    points[2, 3:6] = points[2, :3]
    plain = with_points(hands, points)
    to_size = torch.diag(torch.tensor([scale, scale, 1.0], dtype=torch.float64))
    larger = replace(
        plain,
        observed=replace(
            plain.observed,
            landmarks_2d=points * scale,
            intrinsics=to_size @ CAMERA.expand(COUNT, 3, 3),
        ),
        prediction=replace(
            plain.prediction,
            landmarks_2d=plain.prediction.landmarks_2d * scale,
            log_sigma=plain.prediction.log_sigma + float(torch.tensor(scale).log()),
        ),
    )
    size = (round(640 * scale), round(480 * scale))
    before, after = judge(plain), judge(larger, size)
    assert [verdict.value for verdict in before] == [DOUBTFUL] * 3 + [PLAUSIBLE]
    assert [verdict.value for verdict in after] == [verdict.value for verdict in before]
    assert [len(verdict.reasons) for verdict in after] == [len(one.reasons) for one in before]


def test_verdicts_of_one_hand_do_not_depend_on_the_others(hand: HandModel) -> None:
    hands = exact(hand)
    points = hands.observed.landmarks_2d.clone()
    points[1] = points[1].flip(0)
    points[3, 4] += 60.0
    mixed = with_points(hands, points)
    together = judge(mixed)
    for place in range(COUNT):
        row = slice(place, place + 1)
        alone = replace(
            mixed,
            observed=mixed.observed.select(row),
            prediction=mixed.prediction.select(row),
            scale=mixed.scale[row],
            origins=mixed.origins[row],
        )
        assert judge(alone) == [together[place]]


def fitted(hand: HandModel, landmarks: ImageLandmarks) -> FittedHands:
    """Fit with the settings of `hand-recon fit`, and fewer steps."""
    objective = Objective(
        hand,
        Prior.default(hand),
        Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=False),
    )
    return fit_part(
        landmarks, lambda batch: fit(observed(batch), objective, descent=Descent(steps=100))
    )


def noisy(hand: HandModel) -> ImageLandmarks:
    """Landmarks with a standard deviation of 1 % of the hand."""
    seen = exact(hand).observed
    noise = 2.0 * torch.randn(seen.landmarks_2d.shape, dtype=torch.float64)
    return replace(seen, landmarks_2d=seen.landmarks_2d + noise)


def test_fits_to_noisy_landmarks_are_plausible_and_name_a_wrong_order(hand: HandModel) -> None:
    orders = ("freihand", "interhand", "rhd", "ho3d", "dart")
    good = noisy(hand)
    # All orders in one fit, read as if they were FreiHAND's.
    points = [
        good.landmarks_2d[:, list(landmark_permutation("freihand", order))] for order in orders
    ]
    several = good.select(torch.arange(COUNT).repeat(len(orders)))
    found = judge(fitted(hand, replace(several, landmarks_2d=torch.cat(points))))
    assert {verdict.value for verdict in found[:COUNT]} == {PLAUSIBLE}
    for number, order in enumerate(orders[1:], start=1):
        of_order = found[COUNT * number : COUNT * (number + 1)]
        assert {verdict.value for verdict in of_order} == {DOUBTFUL}
        named = [verdict.reasons[-1].endswith(f"set order={order}.") for verdict in of_order]
        assert sum(named) >= COUNT - 1, order


def test_the_wrong_side_fits_too_and_has_no_verdict(hand: HandModel) -> None:
    """A right hand seen from afar is a left hand that is turned over (decision 59)."""
    good = noisy(hand)
    far = replace(good, intrinsics=None)
    found = judge(fitted(hand, replace(far, left=~far.left)))
    assert [verdict.value for verdict in found].count(PLAUSIBLE) >= COUNT - 1


MATERIAL = os.environ.get("HAND_RECON_MATERIAL")


@pytest.mark.slow
@pytest.mark.skipif(not MATERIAL, reason="HAND_RECON_MATERIAL names no folder with photographs")
def test_landmarks_on_photographs_are_plausible(hand: HandModel) -> None:
    landmarks = read_landmarks(Path(MATERIAL or "") / "pictures" / "test.json")
    few = landmarks.select(torch.linspace(0, len(landmarks) - 1, 60).long())
    values = [verdict.value for verdict in verdicts(fitted(hand, few))]
    assert values.count(PLAUSIBLE) >= 57
