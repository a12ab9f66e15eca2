"""Checks of landmarks, residuals and anatomy of fitted hands, each against a mistake made by hand."""

from dataclasses import replace

import pytest
import torch

from hand_recon.fitting.doubts.anatomy import HAND_LENGTHS, hand_lengths
from hand_recon.fitting.doubts.residuals import relative_residuals
from hand_recon.fitting.verdict import DOUBTFUL, PLAUSIBLE
from hand_recon.hand.model import HandModel
from hand_recon.hand.skeleton import AXES
from tests.support.exact_hands import (
    COUNT,
    SIZE,
    assert_all_say,
    box_side,
    exact,
    judge,
    parameters,
    with_points,
)


def test_few_landmarks_are_doubtful_below_eight(hand: HandModel) -> None:
    hands = exact(hand)
    for count, value in ((7, DOUBTFUL), (8, PLAUSIBLE)):
        labelled = torch.arange(21).expand(COUNT, 21) % 2 == 0
        labelled = labelled & (labelled.cumsum(dim=1) <= count)
        kept = replace(hands, observed=replace(hands.observed, labelled=labelled))
        found = judge(kept)
        assert [verdict.value for verdict in found] == [value] * COUNT
        if value == DOUBTFUL:
            assert_all_say(found, "Only 7 landmarks are given, and below 8")


def test_landmarks_on_a_line_are_doubtful(hand: HandModel) -> None:
    hands = exact(hand)
    points = hands.observed.landmarks_2d.clone()
    points[..., 1] = 400 - 0.7 * points[..., 0]
    flat = replace(
        with_points(hands, points), prediction=replace(hands.prediction, landmarks_2d=points)
    )
    assert_all_say(judge(flat), "The landmarks are on a line: they spread 0.0 % as far across it")


def test_shares_of_the_image_size_are_no_pixels(hand: HandModel) -> None:
    hands = exact(hand)
    shares = hands.observed.landmarks_2d / hands.observed.landmarks_2d.new_tensor(SIZE)
    prediction = replace(
        hands.prediction,
        landmarks_2d=shares,
        log_sigma=hands.prediction.log_sigma - 7,
    )
    found = judge(
        replace(
            with_points(hands, shares),
            prediction=prediction,
        )
    )
    assert all("pixels, expected 4 or more" in verdict.reasons[0] for verdict in found)


def test_sigma_as_large_as_the_hand_is_no_sigma(hand: HandModel) -> None:
    hands = exact(hand)
    side = float(box_side(hands).min())
    for share, value in ((0.06, PLAUSIBLE), (0.5, DOUBTFUL)):
        sigma = torch.full((COUNT, 21, 2), share * side).log()
        found = judge(replace(hands, prediction=replace(hands.prediction, log_sigma=sigma)))
        assert [verdict.value for verdict in found] == [value] * COUNT
        if value == DOUBTFUL:
            assert_all_say(found, "not depths")


def test_few_landmarks_of_large_sigma_are_no_reason(hand: HandModel) -> None:
    hands = exact(hand)
    sigma = torch.zeros(COUNT, 21, 2)
    sigma[:, :9] = 5.0
    found = judge(replace(hands, prediction=replace(hands.prediction, log_sigma=sigma)))
    assert [verdict.value for verdict in found] == [PLAUSIBLE] * COUNT


def test_residuals_are_in_percent_of_the_box_and_shrink_with_sigma(hand: HandModel) -> None:
    hands = exact(hand)
    side = box_side(hands)
    predicted = hands.prediction.landmarks_2d.clone()
    predicted[:, 7, 0] += 0.3 * side
    moved = replace(hands, prediction=replace(hands.prediction, landmarks_2d=predicted))
    # σ is one pixel, below 2 % of the box: the residual counts in full.
    assert relative_residuals(moved)[:, 7].tolist() == pytest.approx([30.0] * COUNT)
    assert relative_residuals(moved)[:, 8].abs().max() < 1e-9
    # σ of 6 % is three times the usual one.
    sigma = (0.06 * side).log().float()[:, None, None].expand(COUNT, 21, 2)
    uncertain = replace(moved, prediction=replace(moved.prediction, log_sigma=sigma))
    assert relative_residuals(uncertain)[:, 7].tolist() == pytest.approx([10.0] * COUNT, rel=1e-5)


@pytest.mark.parametrize(("share", "value"), [(0.11, PLAUSIBLE), (0.13, DOUBTFUL), (1.0, DOUBTFUL)])
def test_one_landmark_far_from_its_projection_is_named(
    hand: HandModel, share: float, value: str
) -> None:
    hands = exact(hand)
    predicted = hands.prediction.landmarks_2d.clone()
    predicted[:, 12, 1] -= share * box_side(hands)
    found = judge(replace(hands, prediction=replace(hands.prediction, landmarks_2d=predicted)))
    assert [verdict.value for verdict in found] == [value] * COUNT
    if value == DOUBTFUL:
        assert_all_say(found, f"The middle tip is {100 * share:.0f} % of the hand's extent from")


def test_an_outlier_is_one_only_where_the_others_fit(hand: HandModel) -> None:
    hands = exact(hand)
    side = box_side(hands)[:, None]
    # All landmarks are off by 3 %, and one by 15 %: five times as far as the others, and below 23 %.
    predicted = hands.prediction.landmarks_2d.clone()
    predicted[..., 0] += 0.03 * side
    predicted[:, 12, 0] += 0.12 * side[:, 0]
    moved = replace(hands.prediction, landmarks_2d=predicted)
    assert {verdict.value for verdict in judge(replace(hands, prediction=moved))} == {PLAUSIBLE}
    # With the others at 2 %, it is seven times as far.
    predicted[..., 0] -= 0.01 * side
    predicted[:, 12, 0] += 0.01 * side[:, 0]
    assert_all_say(judge(replace(hands, prediction=moved)), "The middle tip is 15 %")


@pytest.mark.parametrize(("share", "value"), [(0.065, PLAUSIBLE), (0.075, DOUBTFUL)])
def test_the_mean_residual_has_a_limit(hand: HandModel, share: float, value: str) -> None:
    hands = exact(hand)
    predicted = hands.prediction.landmarks_2d.clone()
    predicted[..., 0] += share * box_side(hands)[:, None]
    found = judge(replace(hands, prediction=replace(hands.prediction, landmarks_2d=predicted)))
    assert [verdict.value for verdict in found] == [value] * COUNT
    if value == DOUBTFUL:
        assert_all_say(found, "The projections are 7.5 % of the hand's extent")


def test_exchanged_fingers_are_named_where_the_fit_is_poor(hand: HandModel) -> None:
    hands = exact(hand)
    exchanged = hands.observed.landmarks_2d.clone()
    # Index and little finger.
    exchanged[:, 5:9], exchanged[:, 17:] = exchanged[:, 17:].clone(), exchanged[:, 5:9].clone()
    # A fit to these landmarks meets them half way.
    met = (exchanged + hands.prediction.landmarks_2d) / 2
    poor = replace(
        with_points(hands, exchanged), prediction=replace(hands.prediction, landmarks_2d=met)
    )
    for verdict in judge(poor):
        assert any(
            "in the order thumb, little, middle, ring, index" in one for one in verdict.reasons
        )
    # Fitted well, knuckles out of line may be those of a hand seen from its side.
    good = replace(
        with_points(hands, exchanged), prediction=replace(hands.prediction, landmarks_2d=exchanged)
    )
    assert {verdict.value for verdict in judge(good)} == {PLAUSIBLE}


def test_a_shape_beyond_the_limit_is_doubtful_in_both_directions(hand: HandModel) -> None:
    for value in (4.6, -4.6):
        found = parameters()
        found.shape[:, 7] = value
        assert_all_say(judge(exact(hand, found)), "The shape is 4.6 standard deviations")
    found.shape[:, 7] = 4.4
    assert {verdict.value for verdict in judge(exact(hand, found))} == {PLAUSIBLE}


def test_the_length_of_a_hand_is_that_of_its_bones() -> None:
    points = torch.randn(1, 21, 3)
    points[0, 0] = torch.tensor([0.0, 0, 0])
    points[0, 9:13] = torch.tensor(
        [[0.09, 0, 0], [0.09, 0.04, 0], [0.09, 0.04, 0.03], [0.07, 0.04, 0.03]]
    )
    # 9 + 4 + 3 + 2 cm, however bent.
    assert hand_lengths(points).tolist() == pytest.approx([0.18])


def test_hands_of_inhuman_length_are_doubtful(hand: HandModel) -> None:
    hands = exact(hand)
    mean = float(hand_lengths(hands.prediction.landmarks_3d)[0])
    assert HAND_LENGTHS[0] < mean < HAND_LENGTHS[1]
    for factor in (0.5, 1.5):
        scaled = replace(hands.prediction, landmarks_3d=hands.prediction.landmarks_3d * factor)
        found = judge(replace(hands, prediction=scaled))
        assert_all_say(
            found, f"The hand is {100 * mean * factor:.1f} cm long, expected 10 to 24 cm"
        )


def test_a_joint_far_outside_its_range_is_named(hand: HandModel) -> None:
    found = parameters()
    # The index finger's PIP bends backwards, by far more than the tolerance.
    found.joint_angles[:, 1, AXES.index("bend")] = -1.0
    assert_all_say(judge(exact(hand, found)), "The bend of the index PIP is ")
    found.joint_angles[:, 1, AXES.index("bend")] = -0.2
    assert {verdict.value for verdict in judge(exact(hand, found))} == {PLAUSIBLE}


@pytest.mark.parametrize("left", [False, True])
def test_fingers_inside_each_other_are_found_on_both_sides(hand: HandModel, left: bool) -> None:
    # The index finger splayed by 25°: in one direction into the middle finger, in the other away from it.
    for splay, value in ((-0.43, DOUBTFUL), (0.43, PLAUSIBLE)):
        found = parameters()
        found.joint_angles[:, 0, AXES.index("splay")] = splay
        judged = judge(exact(hand, found, left=left))
        assert {verdict.value for verdict in judged} == {value}
        if value == DOUBTFUL:
            assert_all_say(judged, "A part of the hand is 9 mm inside another, expected below 8 mm")


def test_penetration_is_not_measured_where_the_loss_excludes_it(hand: HandModel) -> None:
    found = parameters()
    found.joint_angles[:, 0, AXES.index("splay")] = -0.43
    hands = exact(hand, found)
    assert_all_say(judge(hands), " mm inside another")
    without = replace(hands, loss={"non_penetration": torch.zeros(COUNT)})
    assert {verdict.value for verdict in judge(without)} == {PLAUSIBLE}
    # Nor is that of another hand model, whose surface has other triangles.
    mano = replace(hands, origins=tuple(replace(one, hand_model="mano") for one in hands.origins))
    assert {verdict.value for verdict in judge(mano)} == {PLAUSIBLE}
