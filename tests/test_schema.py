"""Selection and concatenation of records, and the crop size without images."""

from dataclasses import fields, replace

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.schema import HandBatch, HandPrediction
from tests.support.views import known_hands, views


@pytest.fixture
def batch(hand: HandModel) -> HandBatch:
    known = views(hand, known_hands(hand, 5))
    return replace(known, label_noise=torch.rand(5, 21), confidence=torch.rand(5, 21))


@pytest.fixture
def prediction(hand: HandModel, batch: HandBatch) -> HandPrediction:
    parameters = known_hands(hand, 5)
    posed = hand.to_camera(parameters)
    assert batch.intrinsics is not None
    return HandPrediction(
        parameters, posed.vertices, posed.joints, posed.landmarks, batch.landmarks_2d,
        torch.randn(5, 21, 2), batch.intrinsics, torch.rand(5, 21),
    )  # fmt: skip


def same(first: object, second: object) -> None:
    for field in fields(first):  # type: ignore[arg-type]  # every record is a dataclass
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, torch.Tensor):
            assert torch.equal(a, b), field.name
        elif a is not None and hasattr(a, "select"):
            same(a, b)
        else:
            assert a == b, field.name


def test_selected_parts_of_a_prediction_join_to_the_whole(prediction: HandPrediction) -> None:
    pieces = [prediction.select(slice(first, first + 2)) for first in (0, 2, 4)]
    assert [len(piece.landmarks_3d) for piece in pieces] == [2, 2, 1]
    joined = HandPrediction.join(pieces)
    assert type(joined) is HandPrediction
    same(joined, prediction)


def test_an_absent_field_stays_absent(prediction: HandPrediction) -> None:
    without = replace(prediction, correlation=None)
    pieces = [without.select(slice(0, 3)), without.select(slice(3, 5))]
    assert pieces[0].correlation is None
    assert HandPrediction.join(pieces).correlation is None


@pytest.mark.parametrize(
    "which", [torch.tensor([3, 0, 3]), torch.tensor([True, False, True, True, False])]
)
def test_select_indexes_every_field(prediction: HandPrediction, which: torch.Tensor) -> None:
    indices = torch.arange(5)[which].tolist()
    chosen = prediction.select(which)
    assert len(chosen.vertices) == 3
    for position, index in enumerate(indices):
        assert torch.equal(chosen.vertices[position], prediction.vertices[index])
        assert torch.equal(chosen.log_sigma[position], prediction.log_sigma[index])
        assert torch.equal(
            chosen.parameters.joint_angles[position], prediction.parameters.joint_angles[index]
        )


def test_a_selected_batch_keeps_index_and_source(batch: HandBatch) -> None:
    chosen = batch.select(torch.tensor([4, 1]))
    assert len(chosen) == 2
    assert chosen.index.tolist() == [4, 1]
    assert chosen.source == ("hand 4", "hand 1")
    assert chosen.landmarks_3d is not None
    assert batch.landmarks_3d is not None
    assert torch.equal(chosen.landmarks_3d[0], batch.landmarks_3d[4])


def test_joined_batches_name_all_their_sources(batch: HandBatch) -> None:
    joined = HandBatch.join([batch.select(slice(0, 2)), batch.select(slice(2, 5))])
    same(joined, batch)
    assert joined.source == batch.source


def test_landmarks_alone_are_in_a_crop_of_the_reference_size(batch: HandBatch) -> None:
    assert batch.image.shape == (5, 3, 0, 0)
    assert batch.crop_size == 224
    assert replace(batch, image=torch.zeros(5, 3, 64, 64)).crop_size == 64
