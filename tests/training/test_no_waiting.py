"""A training step in which the processor never waits for a GPU, shown on a device without values."""

import contextlib
from typing import Any

import pytest
import torch
from torch import nn
from torch._subclasses.fake_tensor import FakeTensorMode

from gpu.rows import photo_augmentation
from hand_recon.data.datamodule import HandDataModule
from hand_recon.data.dataset import load_batch
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.fixed_size import FixedSizeNonPenetration
from hand_recon.knowledge.penetration.places import Places
from hand_recon.knowledge.terms import NonPenetrationTerm
from hand_recon.runs.configuration import build_prior
from hand_recon.training.module import HandReconstruction
from hand_recon.training.non_finite import LossGuard
from tests.support.configurations import composed
from tests.support.numbered_hands import NumberedHands
from tests.support.random_surfaces import random_vertices
from tests.support.resident_hands import module_of, resident
from tests.support.watched import Watched
from tests.support.without_values import META, nothing_is_copied


def module_for_photos(stage: int) -> HandReconstruction:
    """A small network with all that `recipe=photos` trains it with, in a stage of the data term."""
    module = module_of(5)
    settings = composed("recipe=photos", "prior.non_penetration.sizes=fixed")
    module.prior = build_prior(settings.prior, module.regressor.hand)
    if stage:
        module.data_term.begin(step=3, epoch=0, total_steps=4)
    return module.to(META)


@pytest.mark.parametrize("stage", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_a_step_reads_no_value_and_copies_nothing(
    monkeypatch: pytest.MonkeyPatch, stage: int
) -> None:
    # There is no mixed precision on this device; a GPU's loss is read a step later (test_non_finite).
    monkeypatch.setattr(torch, "autocast", lambda *kind, **settings: contextlib.nullcontext())
    monkeypatch.setattr(LossGuard, "watch", lambda *step: None)
    module = module_for_photos(stage)
    assert list(module.prior.terms) == [
        "range_of_motion",
        "non_penetration",
        "shape",
        "natural_pose",
    ]
    batch = resident(open_hand(), 6).batch(torch.arange(6)).to(META)
    with META:  # Draws are made on the device.
        batch = photo_augmentation()(batch)
    with nothing_is_copied():
        losses = module.training_step(batch, 0)
        losses["loss"].backward()
        learning = [one for one in module.parameters() if one.requires_grad]
        nn.utils.clip_grad_norm_(learning, 1.0)
        # The fused kernel, which needs values, has the same loop without them.
        torch.optim.AdamW(learning, foreach=True).step()
    assert losses["loss"].device == META
    assert {one.grad is None for one in module.regressor.decoders.parameters()} == {False}


def test_by_pose_the_same_step_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "autocast", lambda *kind, **settings: contextlib.nullcontext())
    module = module_of(5).to(META)  # On no CUDA device, `auto` is by pose.
    batch = resident(open_hand(), 2).batch(torch.arange(2)).to(META)
    with META:
        batch = photo_augmentation()(batch)
    with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
        module.training_step(batch, 0)


def test_the_end_of_an_epoch_says_what_had_no_place(caplog: pytest.LogCaptureFixture) -> None:
    """Validation, which has no gradients, counts, too."""
    module, hand = module_of(5), open_hand()
    term = NonPenetrationTerm(hand, sizes="fixed")
    assert isinstance(term.non_penetration, FixedSizeNonPenetration)
    term.non_penetration.places = Places(inside=1, spare=0)
    module.prior.terms["non_penetration"] = term
    crossed = random_vertices(hand, 2, spread=0.8)
    term.non_penetration(crossed.requires_grad_()).sum().backward()
    with torch.inference_mode():
        term.non_penetration(crossed)
    module.on_train_epoch_end()
    assert "left out the least deep" in caplog.text
    assert "of 4 hands" in caplog.text


class Copies(Watched):
    """Records for every copy between devices if it is waited for."""

    def __init__(self) -> None:
        super().__init__()
        self.waited_for: list[bool] = []

    def look(
        self, operation: object, args: tuple[Any, ...], named: dict[str, Any], result: object
    ) -> None:
        """Record an operation if it is a copy."""
        if operation is torch.ops.aten._to_copy.default:
            self.waited_for.append(not named.get("non_blocking", False))


@pytest.mark.parametrize(("device", "waits"), [("cuda", False), ("meta", True)])
def test_batches_go_to_a_gpu_without_waiting(device: str, waits: bool) -> None:
    """A simulated GPU; elsewhere, nothing promises that memory stays as it is until it is copied."""
    data = HandDataModule(*[lambda: NumberedHands(4)] * 3, crop_size=16, batch_size=4)
    batch = load_batch(NumberedHands(4), [0, 1])
    with FakeTensorMode(allow_non_fake_inputs=True), Copies() as copies:
        moved = data.transfer_batch_to_device(batch, torch.device(device), 0)
    assert moved.image.device.type == device
    assert len(copies.waited_for) >= 4
    assert set(copies.waited_for) == {waits}


def test_copies_and_values_are_errors_on_this_device() -> None:
    there = torch.zeros(4, 3, device=META)
    with nothing_is_copied():
        there[:2, 0] = there[2:, 1] * 2.0
        with pytest.raises(AssertionError, match="A list of indices"):
            there[:, [0, 2]]
        with pytest.raises(AssertionError, match="A list of indices"):
            there[..., (0, 2)] = 1.0
        with pytest.raises(AssertionError, match="Numbers of the processor"):
            torch.tensor([1.0, 2.0], device=META)
        with pytest.raises(AssertionError, match="to the device"):
            torch.ones(3).to(there)
        with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
            bool(there.any())
        with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
            there.nonzero()
