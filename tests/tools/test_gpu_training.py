"""Training for one GPU, as far as a processor can show it: order, limits, guards and scores."""

import itertools
import math
import time
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from gpu.resident import ResidentHands
from gpu.rows import photo_augmentation
from gpu.scoring import score
from gpu.training import Order, Plan, augmented, learning_rate_factor, seed_of, train_row
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.training.module import HandReconstruction
from hand_recon.training.schedules import warmup_cosine
from tests.support.resident_hands import module_of, resident

QUIET = Plan(seconds=600.0, batch_size=4, every=1e9)


@pytest.fixture(scope="module")
def hands() -> ResidentHands:
    torch.manual_seed(1)
    return resident(open_hand(), 6)


def weights_of(module: HandReconstruction) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in module.regressor.state_dict().items()}


def test_every_real_hand_comes_once_before_any_comes_again() -> None:
    plan = replace(QUIET, batch_size=4, rendered_share=0.25)
    batches = list(itertools.islice(Order(6, 100, plan), 4))
    real = torch.cat([batch[batch < 6] for batch in batches])
    assert [int((batch >= 6).sum()) for batch in batches] == [1, 1, 1, 1]
    assert sorted(real[:6].tolist()) == sorted(real[6:12].tolist()) == list(range(6))
    assert all((batch < 106).all() for batch in batches)


def test_without_rendered_hands_batches_are_real() -> None:
    batches = itertools.islice(Order(3, 0, replace(QUIET, batch_size=8)), 3)
    rows = torch.cat(list(batches))
    assert len(rows) == 24
    assert torch.bincount(rows).tolist() == [8, 8, 8]


def test_the_order_depends_on_the_seed_alone() -> None:
    def first(seed: int) -> list[int]:
        rows: list[int] = next(
            iter(Order(50, 50, replace(QUIET, seed=seed, batch_size=32)))
        ).tolist()
        return rows

    assert first(3) == first(3)
    assert first(3) != first(4)
    assert seed_of(1, 2) != seed_of(12)


@pytest.mark.parametrize("step", [0, 7, 99, 100, 350, 999])
def test_the_learning_rate_is_that_of_the_schedule_by_steps(step: int) -> None:
    optimizer = torch.optim.SGD([nn.Parameter(torch.zeros(1))], lr=1.0)
    expected = warmup_cosine(optimizer, total_steps=1000, warmup_steps=100).lr_lambdas[0](step)
    assert learning_rate_factor(step, step / 1000, 100) == pytest.approx(expected)


def test_the_learning_rate_ends_at_zero_and_never_rises_after_the_end() -> None:
    assert learning_rate_factor(5000, 1.0, 100) == pytest.approx(0.0, abs=1e-12)
    assert learning_rate_factor(5000, 1.3, 100) == pytest.approx(0.0, abs=1e-12)


def test_all_stages_are_run_and_the_weights_change(hands: ResidentHands) -> None:
    module = module_of(5)
    before = weights_of(module)
    found = train_row(module, hands, None, photo_augmentation(), replace(QUIET, steps=4, every=0))
    assert (found.steps, found.stage) == (4, 1)
    assert [entry["share"] for entry in found.curve] == [0.0, 0.25, 0.5, 0.75]
    assert {"loss", "data", "range_of_motion", "non_penetration", "shape", "located"} <= set(
        found.curve[0]
    )
    assert found.images_per_second == pytest.approx(16 / found.seconds, rel=0.05)
    after = module.regressor.state_dict()
    assert any(not torch.equal(value, after[name]) for name, value in before.items())


def test_rows_with_one_stage_stay_in_it(hands: ResidentHands) -> None:
    found = train_row(module_of(1), hands, None, photo_augmentation(), replace(QUIET, steps=2))
    assert (found.steps, found.stage) == (2, 0)


def test_a_training_with_the_same_seed_has_the_same_weights(hands: ResidentHands) -> None:
    found = []
    for seed in (0, 0, 1):
        module = module_of(4)
        plan = replace(QUIET, steps=3, seed=seed, warmup=1)
        torch.manual_seed(7)
        train_row(module, hands, hands, photo_augmentation(), plan)
        found.append(weights_of(module)["decoders.root.weight"])
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


class Clock:
    """A clock that goes on by itself with each look."""

    def __init__(self, tick: float) -> None:
        self.now, self.tick = 0.0, tick

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


@pytest.mark.parametrize("steps", [None, 10_000])
def test_the_time_limit_holds_with_and_without_steps(
    hands: ResidentHands, monkeypatch: pytest.MonkeyPatch, steps: int | None
) -> None:
    clock = Clock(1.0)
    monkeypatch.setattr(time, "monotonic", clock)
    plan = replace(QUIET, seconds=30.0, steps=steps)
    found = train_row(module_of(1), hands, None, photo_augmentation(), plan)
    assert 1 < found.steps < 30
    # Beyond the limit by the looks at the clock of one step and of the end.
    assert 30.0 <= found.seconds < 40.0


def test_a_loss_that_is_not_finite_ends_the_row_and_names_the_hands(hands: ResidentHands) -> None:
    module = module_of(1)
    broken = replace(hands, landmarks_2d=hands.landmarks_2d * math.inf)
    with pytest.raises(FloatingPointError, match=r"not finite at step 0: .*'loss': .*\.jpg"):
        train_row(module, broken, None, photo_augmentation(), replace(QUIET, steps=3))


def test_a_loss_of_the_last_step_is_looked_at_too(hands: ResidentHands) -> None:
    broken = replace(hands, landmarks_2d=hands.landmarks_2d * math.inf)
    with pytest.raises(FloatingPointError, match="not finite at step 0"):
        train_row(module_of(1), broken, None, photo_augmentation(), replace(QUIET, steps=1))


def test_augmentation_of_the_same_seed_is_the_same(hands: ResidentHands) -> None:
    batch = hands.batch(torch.arange(4))
    first, second, other = (augmented(batch, photo_augmentation(), seed) for seed in (5, 5, 6))
    assert torch.equal(first.image, second.image)
    assert torch.equal(first.landmarks_2d, second.landmarks_2d)
    assert not torch.equal(first.image, other.image)


def test_scores_are_those_of_all_hands_and_of_their_folders(
    hand: HandModel, hands: ResidentHands
) -> None:
    module = module_of(5)
    found = score(module, hands, batch_size=4)
    assert set(found) == {"all", "a", "b"}
    assert {"E_J", "E_2D", "PCK@0.10", "PR", "ROM", "coverage_1sigma"} <= set(found["all"])
    assert found["all"]["E_2D"] == pytest.approx((found["a"]["E_2D"] + found["b"]["E_2D"]) / 2)
    # Scored again, and in other batches, nothing is left of the first time.
    again = score(module, hands, batch_size=6)
    assert again["all"] == pytest.approx(found["all"], rel=1e-4)


def test_hands_without_3d_and_without_folders_have_2d_scores(hands: ResidentHands) -> None:
    plain = replace(
        hands, landmarks_3d=None, names=tuple(str(number) for number in range(len(hands)))
    )
    found = score(module_of(1), plain)
    assert set(found) == {"all"}
    assert "E_2D" in found["all"]
    assert "E_J" not in found["all"]
