"""The losses, the stages of the data term, and errors in a training step."""

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import lightning
import pytest
import torch
from torch.utils.data import DataLoader

from hand_recon.evaluation.hand_scores import Scores
from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.knowledge.terms import RangeOfMotionTerm, ShapeTerm
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.image_encoder import ImageEncoder
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.schema import HandBatch
from hand_recon.training.module import STAGE_LEFT, HandReconstruction
from hand_recon.training.supervision import Landmarks3D
from hand_recon.uncertainty import (
    DataTerm,
    FullCovariance,
    NegativeLogLikelihood,
    SquaredError,
    Staged,
)
from tests.support.small_runs import BARE_TRAINER_WARNINGS
from tests.support.tolerance import assert_close
from tests.support.views import known_hands, views

pytestmark = BARE_TRAINER_WARNINGS


@pytest.fixture
def scores(hand: HandModel) -> Callable[[], Scores]:
    return partial(Scores, load_ranges("literature", hand.rest_angles), None)


def biomechanics(hand: HandModel) -> Prior:
    """Row 2 of Table 1."""
    return Prior({"range_of_motion": RangeOfMotionTerm(hand), "shape": ShapeTerm(hand)})


@pytest.fixture
def module(hand: HandModel, scores: Callable[[], Scores]) -> HandReconstruction:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none")
    return HandReconstruction(
        Regressor(encoder, hand, width=32),
        biomechanics(hand),
        SquaredError(),
        scores=scores,
        optimizer=torch.optim.Adam,
    )


@pytest.fixture
def lifter(
    hand: HandModel, scores: Callable[[], Scores]
) -> Callable[[DataTerm], HandReconstruction]:
    """Makes a small lifter with a data term."""

    def make(data_term: DataTerm, supervision: Landmarks3D | None = None) -> HandReconstruction:
        encoder = LandmarkEncoder(width=32, depth=1, landmark_dropout=0.0)
        correlated = data_term.needs_correlation
        # The hand that all tests share may have been put into evaluation mode with another network.
        own = copy.deepcopy(hand).train()
        return HandReconstruction(
            Regressor(encoder, own, width=32, dropout=0.0, correlated=correlated),
            biomechanics(hand),
            data_term,
            scores=scores,
            optimizer=partial(torch.optim.Adam, lr=1e-4),
            supervision=supervision,
        )

    return make


def batch(size: int = 64) -> HandBatch:
    return HandBatch(
        torch.rand(4, 3, size, size), torch.rand(4, 21, 2) * size,
        torch.ones(4, 21, dtype=torch.bool), torch.arange(4), ("a", "b", "c", "d"),
    )  # fmt: skip


def test_the_loss_is_the_data_term_and_the_weighted_prior(module: HandReconstruction) -> None:
    module.eval()
    hands = batch()
    losses = module.losses(hands, module(hands))
    expected = losses["data"] + 20_000 * losses["range_of_motion"] + 10 * losses["shape"]
    torch.testing.assert_close(losses["loss"], expected)
    residual = (module(hands).landmarks_2d - hands.landmarks_2d) * 224 / 64
    torch.testing.assert_close(losses["data"], residual.square().sum(dim=(1, 2)).mean())


def test_a_given_sigma_of_the_labels_adds_its_variance(
    lifter: Callable[[DataTerm], HandReconstruction],
) -> None:
    plain = lifter(NegativeLogLikelihood()).eval()
    given = copy.deepcopy(plain)
    given.label_sigma = "given"
    noise = torch.full((4, 21), 3.0 * 64 / 224)
    noise[0, 5] = torch.nan  # Unknown: as if it were exact.
    hands = replace(batch(), label_noise=noise)
    seen = plain(hands)
    # With a predicted σ of 4 px and a label's of 3 px, the residual has 5 px.
    four = replace(seen, log_sigma=torch.full_like(seen.log_sigma, math.log(4.0)))
    five = replace(seen, log_sigma=torch.full_like(seen.log_sigma, math.log(5.0)))
    five.log_sigma[0, 5] = math.log(4.0)
    assert_close(given.losses(hands, four)["data"], plain.losses(hands, five)["data"])
    without = replace(hands, label_noise=None)
    assert torch.equal(plain.losses(hands, four)["data"], given.losses(without, four)["data"])
    with pytest.raises(ValueError, match="learnt, given"):
        HandReconstruction(
            plain.regressor, plain.prior, SquaredError(), scores=lambda: plain.validation,
            optimizer=torch.optim.Adam, label_sigma="guessed",
        )  # fmt: skip


def test_a_loss_that_is_no_number_stops_the_run_and_names_the_samples(
    module: HandReconstruction,
) -> None:
    hands = batch()
    hands.landmarks_2d[1, 3] = float("inf")
    with pytest.raises(FloatingPointError, match=r"not finite.*'a', 'b'"):
        module.training_step(hands, 0)


def test_3d_labels_join_the_loss_only_where_they_are_given(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    hands = views(hand, known_hands(hand, 3))
    without, with_labels = (
        lifter(SquaredError()),
        lifter(SquaredError(), Landmarks3D(weight=500_000.0)),
    )
    with_labels.load_state_dict(without.state_dict())
    prediction = without(hands)
    losses = [each.losses(hands, prediction) for each in (without, with_labels)]
    assert "landmarks_3d" not in losses[0]
    about = prediction.landmarks_3d - prediction.landmarks_3d[:, 9:10]
    assert hands.landmarks_3d is not None
    ground_truth = hands.landmarks_3d - hands.landmarks_3d[:, 9:10]
    expected = 500_000 * (about - ground_truth).square().sum(dim=(1, 2)).mean()
    assert_close(losses[1]["weighted/landmarks_3d"], expected)
    assert_close(losses[1]["loss"] - losses[0]["loss"], expected)


def test_hands_without_3d_labels_are_validated_and_not_learnt_from(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    module = lifter(SquaredError(), Landmarks3D())
    hands = replace(views(hand, known_hands(hand, 3)), landmarks_3d=None)
    losses = module.eval().losses(hands, module(hands))
    terms = [value for name, value in losses.items() if name.startswith("weighted/")]
    assert_close(losses["loss"], losses["data"] + sum(terms))
    assert "landmarks_3d" not in losses
    with pytest.raises(ValueError, match="supervision=landmarks_2d"):
        module.train().losses(hands, module(hands))


def near(hand: HandModel, module: HandReconstruction, off: float = 4.0) -> HandBatch:
    """Landmarks about `off` pixels from the module's prediction, so that σ stays within its bounds."""
    hands = views(hand, known_hands(hand, 8))
    with torch.no_grad():
        found = module(hands).landmarks_2d
    return replace(hands, landmarks_2d=found + off * torch.randn(8, 21, 2))


class Switch(lightning.Callback):
    """Records the stage and σ of every step, after the loss and before the weights change."""

    def __init__(self) -> None:
        self.stages: list[int] = []
        self.expected: list[torch.Tensor] = []
        self.predicted: list[torch.Tensor] = []

    def on_train_batch_start(self, trainer: Any, pl_module: Any, batch: Any, _: int) -> None:  # noqa: ANN401
        self.batch = batch
        self.expected.append(pl_module.data_term.running_log_sigma().clone())

    def on_before_zero_grad(self, trainer: Any, pl_module: Any, optimizer: Any) -> None:  # noqa: ANN401
        self.stages.append(pl_module.data_term.stage)
        with torch.no_grad():
            self.predicted.append(pl_module(self.batch).log_sigma.mean(dim=0))


def trainer(steps: int, *callbacks: lightning.Callback) -> lightning.Trainer:
    return lightning.Trainer(
        max_steps=steps, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False, callbacks=list(callbacks),
        limit_val_batches=1,
    )  # fmt: skip


def loader(hands: HandBatch, times: int) -> DataLoader[HandBatch]:
    return DataLoader([hands] * times, batch_size=None)  # type: ignore[arg-type]  # a list will do


def staged(at: float = 3) -> Staged:
    return Staged(SquaredError(), NegativeLogLikelihood(), switch_at=at, unit="step")


def test_at_the_switch_sigma_starts_at_the_residuals_that_there_are(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    module, look = lifter(staged()), Switch()
    hands = near(hand, module)
    trainer(5, look).fit(module, loader(hands, 5))
    assert look.stages == [0, 0, 0, 1, 1]
    # Before the switch, σ has its initial value, whatever the residuals are.
    assert_close(look.predicted[2], torch.full((21, 2), 1.5))
    assert_close(look.predicted[3], look.expected[3])
    assert 0.8 < float(look.expected[3].mean()) < 2.0  # Four pixels are 1.4.
    assert float(look.expected[3].std()) > 0.05


def test_a_term_of_one_stage_leaves_sigma_where_it_starts(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    module = lifter(NegativeLogLikelihood())
    before = module.regressor.initial_state.clone()
    trainer(3).fit(module, loader(near(hand, module), 3))
    assert torch.equal(module.regressor.initial_state, before)


def test_any_checkpoint_of_the_last_stage_is_taken_before_one_of_the_first(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    module = lifter(staged())
    good, bad = near(hand, module, 1.0), near(hand, module, 40.0)

    def selection(hands: HandBatch) -> tuple[float, float]:
        running = trainer(1)
        running.validate(module, loader(hands, 1), verbose=False)
        found = running.callback_metrics
        return float(found["val/selection"]), float(found["val/loss"])

    first, loss = selection(good)
    assert first == pytest.approx(loss + STAGE_LEFT)
    module.data_term.observe(4 * torch.ones(8, 21, 2), good.labelled)
    module.data_term.begin(step=3, epoch=0, total_steps=9)
    second, worse = selection(bad)
    assert second == worse
    assert worse > loss
    assert second < first
    module.data_term = SquaredError()
    assert selection(good)[0] == selection(good)[1]


def test_a_loaded_checkpoint_has_the_loss_of_its_stage(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    module = lifter(staged())
    hands = near(hand, module)
    trainer(5).fit(module, loader(hands, 5))
    state = copy.deepcopy(module.state_dict())
    again = lifter(staged())
    again.load_state_dict(state, strict=True)
    assert again.data_term.stage == 1
    # The continued run never switches again.
    assert not again.data_term.begin(step=9, epoch=3, total_steps=12)
    expected, found = (each.eval().losses(hands, each(hands)) for each in (module, again))
    assert_close(found["loss"], expected["loss"])
    assert_close(again.data_term.running_log_sigma(), module.data_term.running_log_sigma())


def test_a_full_covariance_learns_its_correlation(
    hand: HandModel, lifter: Callable[..., HandReconstruction]
) -> None:
    """Errors of both coordinates that are alike: ρ goes up from zero, below one."""
    module = lifter(FullCovariance())
    hands = near(hand, module, 0.0)
    together = replace(hands, landmarks_2d=hands.landmarks_2d + 4 * torch.randn(8, 21, 1))
    assert torch.equal(module(together).correlation, torch.zeros(8, 21))
    optimizer = module.optimizer(module.regressor.decoders.parameters())
    for _ in range(100):
        optimizer.zero_grad()
        losses = module.losses(together, module(together))
        losses["loss"].backward()
        optimizer.step()
    correlation = module(together).correlation
    assert 0.05 < float(correlation.mean().detach()) < 1
    assert float(correlation.abs().max().detach()) < 1
