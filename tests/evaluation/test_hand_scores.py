"""All scores of a reconstruction: their presence, means and values of single hands."""

from dataclasses import replace

import pytest
import torch

from hand_recon.evaluation.hand_scores import Scores
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.schema import HandBatch, HandPrediction
from tests.support.views import known_hands, views

COUNT = 6


@pytest.fixture
def batch(hand: HandModel) -> HandBatch:
    return views(hand, known_hands(hand, COUNT))


@pytest.fixture
def prediction(hand: HandModel, batch: HandBatch) -> HandPrediction:
    """Ground truth of other poses, so that every hand has another error."""
    parameters = known_hands(hand, COUNT)
    posed = hand.to_camera(parameters)
    assert batch.intrinsics is not None
    return HandPrediction(
        parameters, posed.vertices, posed.joints, posed.landmarks,
        batch.landmarks_2d + 3.0, torch.full((COUNT, 21, 2), 1.0), batch.intrinsics,
    )  # fmt: skip


def scores(hand: HandModel) -> Scores:
    return Scores(load_ranges("literature", hand.rest_angles), None)


def test_the_means_are_those_of_the_hands(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    measured = scores(hand)
    # In two parts, out of order, and one hand twice, as a distributed sampler pads.
    for part in ([4, 0, 2], [1, 5, 3, 0]):
        which = torch.tensor(part)
        measured.update(batch.select(which), prediction.select(which))
    means = measured.compute()
    index, columns = measured.per_hand()
    assert sorted(index.tolist()) == list(range(COUNT))
    assert {"E_J", "E_V", "MPJPE", "F@5", "AUC_J"} <= set(columns)
    for name, values in columns.items():
        assert values.shape == (COUNT,)
        assert float(values.mean()) == pytest.approx(means[name], rel=1e-5), name
    assert float(columns["E_J"].std()) > 0.5  # Millimetres; the errors differ.


def test_each_row_is_the_score_of_that_hand_alone(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    together = scores(hand)
    together.update(batch, prediction)
    index, columns = together.per_hand()
    for row, sample in enumerate(index.tolist()):
        alone = scores(hand)
        which = torch.tensor([sample])
        alone.update(batch.select(which), prediction.select(which))
        assert float(columns["E_J"][row]) == pytest.approx(alone.compute()["E_J"], rel=1e-5)


def test_the_scores_of_each_hand_are_kept_after_a_reset(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    measured = scores(hand)
    measured.update(batch, prediction)
    expected = measured.compute()["E_J"]
    measured.reset()
    index, columns = measured.last_per_hand
    assert len(index) == COUNT
    assert float(columns["E_J"].mean()) == pytest.approx(expected, rel=1e-5)
    assert measured.per_hand()[1] == {}


def test_without_ground_truth_there_are_no_3d_scores(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    measured = scores(hand)
    measured.update(replace(batch, landmarks_3d=None, vertices=None), prediction)
    found = measured.compute()
    assert "E_J" not in found
    # Three pixels in each coordinate of every landmark.
    assert found["E_2D"] == pytest.approx(3 * 2**0.5, rel=1e-4)
    assert "PR" not in found
    index, columns = measured.per_hand()
    assert len(index) == 0
    assert columns == {}


def test_a_hand_without_ground_truth_has_a_nan_in_its_row(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    assert batch.landmarks_3d is not None
    ground_truth = batch.landmarks_3d.clone()
    ground_truth[2] = torch.nan
    measured = scores(hand)
    measured.update(replace(batch, landmarks_3d=ground_truth), prediction)
    index, columns = measured.per_hand()
    missing = columns["E_J"].isnan()
    assert index[missing].tolist() == [2]


def test_the_penetration_rate_is_measured_where_non_penetration_is_given(
    hand: HandModel, batch: HandBatch, prediction: HandPrediction
) -> None:
    measured = Scores(load_ranges("literature", hand.rest_angles), NonPenetration(hand))
    measured.update(batch, prediction)
    penetrating = (NonPenetration(hand)(prediction.vertices) > 0).float().mean()
    assert measured.compute()["PR"] == pytest.approx(100 * float(penetrating), abs=1e-4)
