"""The landmark encoder: dropped landmarks, confidence, and error feedback that fits landmarks."""

from dataclasses import replace

import pytest
import torch

from hand_recon.data.augment import move
from hand_recon.hand.model import HandModel
from hand_recon.hand.upright import upright_motion
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.image_encoder import ImageEncoder
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.schema import HandBatch
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views


@pytest.fixture
def seen(hand: HandModel) -> HandBatch:
    """Six hands with some landmarks missing and a detector's confidence."""
    batch = views(hand, known_hands(hand, 6))
    labelled = torch.rand(6, 21) > 0.2
    labelled[5] = False  # Nothing at all.
    return replace(batch, labelled=labelled, confidence=torch.rand(6, 21))


@pytest.fixture
def encoder() -> LandmarkEncoder:
    return LandmarkEncoder(width=32, depth=2).eval()


def lifter(hand: HandModel, landmark_dropout: float = 0.0) -> Regressor:
    return Regressor(
        LandmarkEncoder(width=64, depth=1, landmark_dropout=landmark_dropout), hand, width=128, dropout=0.0,
        activation=True, reprojection=True,
    )  # fmt: skip


def at_missing(batch: HandBatch, value: float) -> HandBatch:
    missing = ~batch.labelled
    assert batch.confidence is not None
    return replace(
        batch,
        landmarks_2d=batch.landmarks_2d.masked_fill(missing[..., None], value),
        confidence=batch.confidence.masked_fill(missing, value),
    )


def test_a_missing_landmark_changes_neither_the_features_nor_their_gradient(
    encoder: LandmarkEncoder, seen: HandBatch
) -> None:
    results = []
    for value in (0.0, torch.nan, 1e6):
        batch = at_missing(seen, value)
        leaf = batch.landmarks_2d.clone().requires_grad_()
        encoder.zero_grad()
        features = encoder.features(replace(batch, landmarks_2d=leaf))
        features.square().sum().backward()
        assert leaf.grad is not None
        assert leaf.grad[~seen.labelled].count_nonzero() == 0
        weights = encoder.first.weight.grad
        assert weights is not None
        results.append((features.detach(), leaf.grad, weights.clone()))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(other, results[0], strict=True))
    assert all(value.isfinite().all() for value in results[0])
    assert (results[0][1][seen.labelled] != 0).any()


def test_the_regressor_does_not_see_a_missing_landmark_either(
    hand: HandModel, seen: HandBatch
) -> None:
    """Error feedback must not pass a dropped label around the encoder."""
    network = lifter(hand).eval()
    first, second = network(at_missing(seen, torch.nan)), network(at_missing(seen, 50.0))
    assert torch.equal(first.landmarks_3d, second.landmarks_3d)
    assert first.landmarks_3d.isfinite().all()


def test_training_drops_landmarks_and_nothing_else_does(seen: HandBatch) -> None:
    many = seen.select(torch.zeros(3000, dtype=torch.int64))
    encoder = LandmarkEncoder(width=8, landmark_dropout=0.15)
    assert encoder.eval().shown(many) is many
    shown = encoder.train().shown(many)
    assert not (shown.labelled & ~many.labelled).any()
    lost = many.labelled[0] & ~shown.labelled
    share = lost[:, many.labelled[0]].float().mean(dim=1)
    assert float(share.mean()) == pytest.approx(0.15, abs=0.015)
    # From none to twice the share.
    assert (share == 0).any()
    assert float(share.max()) > 0.35
    assert many.labelled.all() == seen.labelled[0].all()
    assert LandmarkEncoder(width=8, landmark_dropout=0.0).train().shown(many) is many


def test_dropped_landmarks_do_not_reach_the_answer(
    hand: HandModel, seen: HandBatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    network = lifter(hand, landmark_dropout=0.5).train()
    kept = torch.ones(6, 21, dtype=torch.bool)
    kept[:, 8] = False
    monkeypatch.setattr(network.encoder, "_kept", lambda labelled: kept)
    everything = replace(seen, labelled=torch.ones(6, 21, dtype=torch.bool))
    moved = everything.landmarks_2d.clone()
    moved[:, 8] += 40.0
    first, second = network(everything), network(replace(everything, landmarks_2d=moved))
    assert torch.equal(first.landmarks_2d, second.landmarks_2d)
    moved[:, 7] += 40.0
    third = network(replace(everything, landmarks_2d=moved))
    assert not torch.equal(first.landmarks_2d, third.landmarks_2d)


def test_an_unknown_confidence_is_none(encoder: LandmarkEncoder, seen: HandBatch) -> None:
    none = encoder.features(replace(seen, confidence=None))
    unknown = encoder.features(replace(seen, confidence=torch.full((6, 21), torch.nan)))
    assert torch.equal(none, unknown)
    known = encoder.features(seen)
    assert not torch.allclose(known[:5], none[:5])
    # A confidence of zero differs from an unknown confidence.
    zero = encoder.features(replace(seen, confidence=torch.zeros(6, 21)))
    assert not torch.allclose(zero[:5], none[:5])


def test_without_confidence_the_features_ignore_it(seen: HandBatch) -> None:
    encoder = LandmarkEncoder(width=16, confidence=False).eval()
    assert torch.equal(encoder.features(seen), encoder.features(replace(seen, confidence=None)))


def test_a_crop_twice_as_large_has_the_same_features(
    encoder: LandmarkEncoder, seen: HandBatch
) -> None:
    large = replace(
        seen,
        image=torch.zeros(6, 3, 448, 448, dtype=torch.uint8),
        landmarks_2d=2 * seen.landmarks_2d,
    )
    assert_close(encoder.features(large), encoder.features(seen))


def test_dropping_all_landmarks_is_refused() -> None:
    with pytest.raises(ValueError, match=r"less than 1.*landmark_dropout=1\.0"):
        LandmarkEncoder(landmark_dropout=1.0)


def test_a_model_of_pictures_refuses_landmarks_alone(seen: HandBatch) -> None:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none")
    with pytest.raises(ValueError, match=r"landmarks alone.*model=lifter"):
        encoder(seen)


def test_error_feedback_fits_landmarks_within_a_hundred_steps(hand: HandModel) -> None:
    batch = views(hand, known_hands(hand, 8))
    batch = move(batch, upright_motion(batch.landmarks_2d, batch.labelled, 224))
    network = lifter(hand).train()

    def error() -> torch.Tensor:
        found: torch.Tensor = network(batch).landmarks_2d
        return (found - batch.landmarks_2d).square().sum(dim=-1)

    start = float(error().sqrt().mean().detach())
    optimizer = torch.optim.Adam(network.parameters(), lr=2e-3)
    for _ in range(100):
        optimizer.zero_grad()
        error().mean().backward()
        optimizer.step()
    assert start > 15
    assert float(error().sqrt().mean().detach()) < start / 4


def test_every_round_corrects_the_last_ones_error(hand: HandModel) -> None:
    """A round sees the reprojection error of the state before it, in units of 20 px."""
    batch = views(hand, known_hands(hand, 3))
    network = lifter(hand).eval()
    for parameter in network.decoders.parameters():
        torch.nn.init.zeros_(parameter)
    inputs: list[torch.Tensor] = []
    network.regressor.register_forward_pre_hook(lambda _, given: inputs.append(given[0]))
    prediction = network(batch)
    expected = (prediction.landmarks_2d - batch.landmarks_2d) / 20
    for given in inputs:
        torch.testing.assert_close(
            given[:, -42:], expected.clamp(-10, 10).flatten(1), atol=1e-3, rtol=1e-3
        )
    assert len(inputs) == 3
