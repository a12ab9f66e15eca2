"""2D error and PCK over the labelled landmarks."""

import pytest
import torch

from hand_recon.evaluation.landmarks_2d import Landmarks2D, landmark_error_2d


def test_pixels_are_those_of_the_224_crop() -> None:
    prediction = torch.tensor([[3.0, 4.0]])
    labelled = torch.ones(1, dtype=torch.bool)
    error = landmark_error_2d(prediction, torch.zeros(1, 2), labelled, crop_size=112)
    assert error.tolist() == [10.0]


def test_a_landmark_without_label_has_no_error() -> None:
    labels = torch.tensor([[0.0, 0.0], [float("nan"), float("nan")], [9.0, 9.0]])
    labelled = torch.tensor([True, False, False])
    error = landmark_error_2d(torch.zeros(3, 2), labels, labelled, crop_size=224)
    assert error.isnan().tolist() == [False, True, True]


def test_every_label_counts_alike_and_every_sample_once() -> None:
    # Sample 0: errors 0 and 12 px. Sample 1: one label, 30 px. Sample 0 comes again.
    labels = torch.zeros(3, 2, 2)
    labels[1, 1] = float("nan")
    prediction = torch.tensor(
        [[[0.0, 0.0], [12.0, 0.0]], [[0.0, 30.0], [5.0, 5.0]], [[0.0, 0.0], [12.0, 0.0]]]
    )
    labelled = torch.tensor([[True, True], [True, False], [True, True]])
    metric = Landmarks2D()
    metric.update(prediction, labels, labelled, torch.tensor([0, 1, 0]), crop_size=224)
    scores = metric.compute()
    assert scores == pytest.approx(
        {"E_2D": 14.0, "PCK@0.05": 1 / 3, "PCK@0.10": 2 / 3, "PCK@0.15": 1.0}
    )


def test_batches_of_different_crops_agree() -> None:
    labels, prediction = torch.rand(4, 21, 2) * 224, torch.rand(4, 21, 2) * 224
    labelled = torch.rand(4, 21) > 0.3
    whole, parts = Landmarks2D(), Landmarks2D()
    whole.update(prediction, labels, labelled, torch.arange(4), crop_size=224)
    parts.update(prediction[:1], labels[:1], labelled[:1], torch.arange(1), crop_size=224)
    half = (prediction[1:] / 2, labels[1:] / 2, labelled[1:], torch.arange(1, 4))
    parts.update(*half, crop_size=112)
    assert parts.compute() == pytest.approx(whole.compute(), rel=1e-6)


def test_without_labels_there_are_no_scores() -> None:
    metric = Landmarks2D()
    unlabelled = torch.zeros(1, 21, dtype=torch.bool)
    metric.update(
        torch.zeros(1, 21, 2), torch.zeros(1, 21, 2), unlabelled, torch.arange(1), crop_size=224
    )
    assert metric.compute() == {}


def test_predictions_that_are_not_finite_name_their_samples() -> None:
    labelled = torch.ones(1, 21, dtype=torch.bool)
    broken = torch.full((1, 21, 2), float("nan"))
    with pytest.raises(ValueError, match="2D landmarks of the samples 5 are not finite"):
        Landmarks2D().update(
            broken, torch.zeros(1, 21, 2), labelled, torch.tensor([5]), crop_size=224
        )
