"""Checks of known cameras, each against a mistake made by hand."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hand_recon.fitting.verdict import DOUBTFUL, PLAUSIBLE, verdicts
from hand_recon.hand.model import HandModel
from tests.support.exact_hands import CAMERA, assert_all_say, exact, judge, with_camera


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda k: k * k.new_tensor([[0.5], [0.5], [1]]), "the centre of an image of 322×239"),
        (lambda k: k * k.new_tensor([[2.0], [2.0], [1]]), "the centre of an image of 1288×956"),
        (lambda k: k.new_tensor([[600.0, 0, -5], [0, 600, 239], [0, 0, 1]]), "The principal point (-5, 239)"),
        (lambda k: k.new_tensor([[600.0, 0, 0], [0, 600, 0], [0, 0, 1]]), "The principal point (0, 0)"),
        (lambda k: k.new_tensor([[100.0, 0, 322], [0, 100, 239], [0, 0, 1]]), "The focal length is 100"),
        (lambda k: k.new_tensor([[2e4, 0, 322], [0, 2e4, 239], [0, 0, 1]]), "The focal length is 2e+04"),
        (lambda k: k.new_tensor([[600.0, 0, 322], [0, 900, 239], [0, 0, 1]]), "differ by a factor of 1.50"),
    ],
)  # fmt: skip
def test_camera_matrices_that_contradict_the_image_are_doubtful(
    hand: HandModel, change: Callable[[Tensor], Tensor], text: str
) -> None:
    hands = with_camera(exact(hand), change(CAMERA.clone()))
    assert_all_say(judge(hands), text)
    # Without the image's size, only the focal lengths can be compared with each other.
    alone = {verdict.value for verdict in verdicts(hands)}
    assert alone == ({DOUBTFUL} if "factor" in text else {PLAUSIBLE})


def test_a_camera_divided_by_the_size_of_the_image_is_found_without_the_size(
    hand: HandModel,
) -> None:
    hands = with_camera(exact(hand), CAMERA / CAMERA.new_tensor([[640.0], [480], [1]]))
    for verdict in verdicts(hands):
        assert any("from the optical axis" in reason for reason in verdict.reasons)


@pytest.mark.parametrize("centre", [(200.0, 300.0), (260.0, 200.0), (430.0, 310.0)])
def test_cameras_of_crops_are_plausible(hand: HandModel, centre: tuple[float, float]) -> None:
    cropped = CAMERA.clone()
    cropped[:2, 2] = torch.tensor(centre)
    assert {verdict.value for verdict in judge(with_camera(exact(hand), cropped))} == {PLAUSIBLE}


@pytest.mark.parametrize("depth", [0.05, 12.0])
def test_depths_that_no_hand_is_seen_at_are_doubtful(hand: HandModel, depth: float) -> None:
    hands = exact(hand)
    kept = hands.prediction.parameters
    translation = kept.translation.clone()
    translation[:, 2] = depth
    moved = replace(hands.prediction, parameters=replace(kept, translation=translation))
    assert_all_say(judge(replace(hands, prediction=moved)), f"at a depth of {depth:.2g} m")
    # An assumed camera has depths of its own.
    assumed = replace(hands, prediction=moved, observed=replace(hands.observed, intrinsics=None))
    assert {verdict.value for verdict in judge(assumed)} == {PLAUSIBLE}
    # So has one whose matrix was made for a photograph without a known camera.
    origins = tuple(replace(one, camera="assumed") for one in hands.origins)
    made = replace(hands, prediction=moved, origins=origins)
    assert {verdict.value for verdict in judge(made)} == {PLAUSIBLE}


def test_landmarks_outside_the_image_are_doubtful_if_they_are_most(hand: HandModel) -> None:
    hands = exact(hand)
    hands = replace(hands, observed=replace(hands.observed, intrinsics=None))
    points = hands.observed.landmarks_2d
    middle = float(points[..., 0].median())
    for width, value in ((int(middle) - 60, DOUBTFUL), (int(middle) + 30, PLAUSIBLE)):
        found = judge(hands, (width, 480))
        assert {verdict.value for verdict in found} == {value}
    assert_all_say(
        judge(hands, (10, 10)), "21 of 21 landmarks are outside the image of 10×10 pixels"
    )
    assert {verdict.value for verdict in judge(hands, None)} == {PLAUSIBLE}
