"""The fastest precision of a machine, against its capabilities one by one."""

import pytest
import torch

from hand_recon.command_line.precision import MIXED, SINGLE, fast_precision
from tests.support.configurations import composed

NONE: dict[str, bool] = {}


def _machine(monkeypatch: pytest.MonkeyPatch, *, has: dict[str, bool], cuda: bool | None) -> None:
    """Pretend a processor with these capabilities, and a GPU that computes in bfloat16 or not, or none."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda is not None)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda **_: cuda)


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
    assert fast_precision() == fast_precision("cpu") == expected


@pytest.mark.parametrize(("cuda", "expected"), [(True, MIXED), (False, SINGLE)])
def test_a_gpu_counts_before_its_processor_unless_the_processor_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, *, cuda: bool, expected: str
) -> None:
    _machine(monkeypatch, has={"avx512_bf16": not cuda}, cuda=cuda)
    assert fast_precision() == fast_precision("gpu") == fast_precision("cuda") == expected
    assert fast_precision("cpu") != expected


def test_other_devices_train_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    _machine(monkeypatch, has={"avx512_bf16": True}, cuda=None)
    assert fast_precision("mps") == SINGLE


@pytest.mark.parametrize(("has", "fused"), [(NONE, True), ({"avx512_bf16": True}, False)])
def test_the_recipe_for_photographs_takes_it_and_its_table_does_not(
    monkeypatch: pytest.MonkeyPatch, *, has: dict[str, bool], fused: bool
) -> None:
    _machine(monkeypatch, has=has, cuda=None)
    config = composed("recipe=photos")
    assert config.trainer.precision == fast_precision()
    # Lightning clips gradients of fused optimizers in single precision alone.
    assert config.optimizer.fused is fused
    table = composed("recipe=photos_table1")
    assert (table.trainer.precision, table.optimizer.fused) == (SINGLE, True)
