"""The fastest precision of a machine, against its capabilities one by one."""

import pytest
import torch

from hand_recon.command_line.precision import (
    MIXED,
    SINGLE,
    computes_in_bfloat16,
    fast_precision,
    fused_step,
)
from tests.support.configurations import composed

NONE: dict[str, bool] = {}


def _machine(monkeypatch: pytest.MonkeyPatch, *, has: dict[str, bool], cuda: bool | None) -> None:
    """Pretend a processor with these capabilities, and a GPU that computes in bfloat16 or not, or none."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda is not None)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda **_: cuda)


LITE = "efficientnet_lite0"


@pytest.mark.parametrize(
    ("has", "expected"),
    [
        (NONE, SINGLE),
        ({"avx512_bf16": False, "avx2": True}, SINGLE),
        ({"avx512_bf16": True}, MIXED),
        ({"amx_bf16": True}, MIXED),
    ],
)
def test_a_processor_trains_in_bfloat16_where_it_computes_in_it(
    monkeypatch: pytest.MonkeyPatch, has: dict[str, bool], expected: str
) -> None:
    _machine(monkeypatch, has=has, cuda=None)
    assert computes_in_bfloat16() is (expected == MIXED)
    assert fast_precision("auto", LITE) == fast_precision("cpu", "resnet50") == expected


@pytest.mark.parametrize("backbone", ["mobilenet_v3_large", "timm/resnet18", None])
def test_backbones_of_unknown_speed_train_in_single_precision_on_processors(
    monkeypatch: pytest.MonkeyPatch, backbone: str | None
) -> None:
    _machine(monkeypatch, has={"avx512_bf16": True}, cuda=None)
    assert fast_precision("auto", backbone) == SINGLE
    _machine(monkeypatch, has=NONE, cuda=True)
    assert fast_precision("auto", backbone) == MIXED


@pytest.mark.parametrize(("cuda", "expected"), [(True, MIXED), (False, SINGLE)])
def test_a_gpu_counts_before_its_processor_unless_the_processor_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, *, cuda: bool, expected: str
) -> None:
    _machine(monkeypatch, has={"avx512_bf16": not cuda}, cuda=cuda)
    found = {fast_precision(accelerator, LITE) for accelerator in ("auto", "gpu", "cuda")}
    assert found == {expected}
    assert fast_precision("cpu", LITE) != expected


def test_other_devices_train_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    _machine(monkeypatch, has={"avx512_bf16": True}, cuda=None)
    assert fast_precision("mps", LITE) == SINGLE


@pytest.mark.parametrize("precision", ["32-true", "32", 32, None])
def test_a_step_is_fused_under_every_name_of_single_precision(
    precision: str | int | None,
) -> None:
    assert fused_step(precision) is True


@pytest.mark.parametrize("precision", ["bf16-mixed", "16-mixed", "bf16-true", "64-true"])
def test_elsewhere_the_step_is_pytorchs_choice_and_not_the_slowest(precision: str) -> None:
    """`False` would be the loop over single weights, None leaves it to the device."""
    assert fused_step(precision) is None


@pytest.mark.parametrize(("has", "fused"), [(NONE, True), ({"avx512_bf16": True}, None)])
def test_the_recipe_for_photographs_takes_it_and_its_table_does_not(
    monkeypatch: pytest.MonkeyPatch, *, has: dict[str, bool], fused: bool | None
) -> None:
    _machine(monkeypatch, has=has, cuda=None)
    config = composed("recipe=photos")
    assert config.trainer.precision == fast_precision("auto", LITE)
    # Lightning clips gradients of fused optimizers in single precision alone.
    assert config.optimizer.fused is fused
    other = composed("recipe=photos", "model.encoder.backbone=mobilenet_v3_small")
    assert other.trainer.precision == SINGLE
    assert composed("recipe=photos", "model=lifter").trainer.precision == SINGLE
    table = composed("recipe=photos_table1")
    assert (table.trainer.precision, table.optimizer.fused) == (SINGLE, True)
