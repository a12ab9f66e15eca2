"""Devices and precisions of training for one GPU, and of its files of weights, shown on a processor."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode

from gpu.precision import run_in_bfloat16
from gpu.resident import ResidentHands
from gpu.rows import photo_augmentation
from gpu.training import augmented
from gpu.weights import load_weights, save_weights
from hand_recon.data.augment import to_float
from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor.photo_encoder import PhotoEncoder
from hand_recon.schema import HandBatch
from tests.support.resident_hands import SIZE, module_of, network, resident


@pytest.fixture(scope="module")
def hands() -> ResidentHands:
    torch.manual_seed(1)
    return resident(open_hand(), 6)


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
