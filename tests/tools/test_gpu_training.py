"""Training for one GPU, as far as a processor can show it: order, limits, precision, devices and guards."""

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode

from gpu.precision import run_in_bfloat16
from gpu.resident import ResidentHands
from gpu.rows import VIEW, module_of_row, photo_augmentation
from gpu.scoring import score
from gpu.training import Order, Plan, augmented, learning_rate_factor, seed_of, train_row
from gpu.weights import load_weights, save_weights
from hand_recon.data.augment import to_float
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.error_feedback import Regressor
from hand_recon.regressor.landmark_encoder import LandmarkEncoder
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.schema import HandBatch
from hand_recon.training.module import HandReconstruction
from hand_recon.training.schedules import warmup_cosine
from tests.support.views import known_hands, views

SIZE = 64
QUIET = Plan(seconds=600.0, batch_size=4, every=1e9)


def network(hand: HandModel) -> Regressor:
    """A small network for photographs."""
    encoder = PhotoEncoder(
        "mobilenet_v3_small", "none", landmarks=LandmarkEncoder(16, 1, 0.1), width=8, view=VIEW
    )
    return Regressor(encoder, hand, width=16, dropout=0.0, activation=True, reprojection=True)


def module_of(row: int = 5, *, learning_rate: float = 1e-3) -> HandReconstruction:
    torch.manual_seed(0)
    return module_of_row(row, network(open_hand()), learning_rate=learning_rate, on_gpu=True)


def resident(hand: HandModel, count: int, folders: tuple[str, ...] = ("a", "b")) -> ResidentHands:
    """Hands in images of noise, with labels in crops of `SIZE` pixels and 3D."""
    batch = views(hand, known_hands(hand, count))
    labels = batch.landmarks_2d * SIZE / 224
    images = torch.randint(1, 256, (count, 3, SIZE, SIZE), dtype=torch.uint8)
    names = tuple(f"{folders[number % len(folders)]}/{number}.jpg" for number in range(count))
    return ResidentHands(images, labels, batch.labelled, names, batch.landmarks_3d)


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


def test_on_a_gpu_all_draws_of_the_augmentation_are_made_there() -> None:
    """A simulated device refuses every tensor of another one."""
    with FakeTensorMode(), torch.device("cuda"):
        batch = HandBatch(
            image=torch.zeros(4, 3, SIZE, SIZE, dtype=torch.uint8),
            landmarks_2d=torch.zeros(4, 21, 2),
            labelled=torch.ones(4, 21, dtype=torch.bool),
            index=torch.arange(4),
            source=("",) * 4,
        )
        found = photo_augmentation()(batch)
    assert found.image.device.type == found.landmarks_2d.device.type == "cuda"
    assert found.image.dtype == torch.float32


@pytest.mark.parametrize("training", [True, False])
def test_nothing_in_a_step_is_made_on_another_device(hands: ResidentHands, training: bool) -> None:
    """Tensors that are made without a device land on the meta device, whose values cannot be read."""
    module = module_of(5).train(training)
    batch = augmented(hands.batch(torch.arange(6)), photo_augmentation(), 0)
    module.data_term.begin(step=3, epoch=0, total_steps=4)
    module.test.reset()
    with torch.device("meta"):
        prediction = module(batch)
        losses = module.losses(batch, prediction)
        losses["loss"].backward()
        module.test.update(batch, prediction)
    assert {value.device.type for value in losses.values()} == {"cpu"}
    assert math.isfinite(float(losses["loss"].detach()))


def test_bfloat16_is_for_the_convolutions_alone(
    hands: ResidentHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = module_of(1).eval()
    encoder = module.regressor.encoder
    assert isinstance(encoder, PhotoEncoder)
    batch = to_float(hands.batch(torch.arange(4)))
    with torch.no_grad():
        single = module(batch)
        run_in_bfloat16(encoder.backbone)
        run_in_bfloat16(encoder.maps)
        convolutions: list[torch.dtype] = []
        products: list[torch.dtype] = []
        monkeypatch.setattr(
            nn.Conv2d, "_conv_forward", _noting(nn.Conv2d._conv_forward, convolutions)
        )
        monkeypatch.setattr(nn.Linear, "forward", _noting(nn.Linear.forward, products))
        half = module(batch)
    assert set(convolutions) == {torch.bfloat16}
    assert set(products) == {torch.float32}
    assert half.landmarks_2d.dtype == torch.float32
    difference = (half.landmarks_2d - single.landmarks_2d).abs().amax()
    assert 0 < float(difference) < 0.05 * SIZE


def _noting(plain: Callable[..., Tensor], seen: list[torch.dtype]) -> Callable[..., Tensor]:
    """A function that notes the types of its results."""

    def noted(*inputs: Any) -> Tensor:  # noqa: ANN401
        found = plain(*inputs)
        seen.append(found.dtype)
        return found

    return noted


def test_without_a_compiler_the_convolutions_run_as_they_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*inputs: object, **options: object) -> Callable[..., Tensor]:
        def run(*tensors: Tensor) -> Tensor:
            raise RuntimeError("no compiler here")

        return run

    monkeypatch.setattr(torch, "compile", broken)
    layer = nn.Conv2d(3, 4, 3)
    images = torch.rand(1, 3, 8, 8)
    expected = layer(images)
    run_in_bfloat16(layer, compiled=True)
    for _ in range(2):
        torch.testing.assert_close(layer(images), expected, atol=0.02, rtol=0.02)
    assert capsys.readouterr().out.count("Not compiled: RuntimeError: no compiler here") == 1


def test_weights_survive_their_files(tmp_path: Path) -> None:
    module = module_of(1)
    whole = save_weights(tmp_path / "row1", module.regressor, {"row": "1"}, 1 << 30)
    parts = save_weights(tmp_path / "parts", module.regressor, {"row": "1"}, 1 << 20)
    assert [path.name for path in whole] == ["row1.safetensors"]
    assert len(parts) > 1
    assert parts[1].name == f"parts-2-of-{len(parts)}.safetensors"
    assert max(path.stat().st_size for path in parts) < 1.2 * (1 << 20)
    wanted = module.regressor.state_dict()
    for paths in (whole, parts):
        torch.manual_seed(9)
        other = network(open_hand())
        load_weights(paths, other)
        for name, value in other.state_dict().items():
            torch.testing.assert_close(value, wanted[name], rtol=1e-3, atol=1e-6)
        assert torch.equal(other.hand.template, module.regressor.hand.template)


def test_half_of_the_files_of_a_network_are_refused(tmp_path: Path) -> None:
    module = module_of(1)
    parts = save_weights(tmp_path / "parts", module.regressor, {}, 1 << 20)
    with pytest.raises(ValueError, match="Give all files of a network of the same settings"):
        load_weights(parts[:1], module.regressor)


def test_numbers_beyond_half_precision_stay_in_single_precision(tmp_path: Path) -> None:
    module = module_of(1)
    with torch.no_grad():
        next(module.regressor.decoders.parameters()).fill_(1e6)
    other = network(open_hand())
    load_weights(save_weights(tmp_path / "row1", module.regressor, {}, 1 << 30), other)
    assert (next(other.decoders.parameters()) == 1e6).all()


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
