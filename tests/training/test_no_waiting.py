"""A training step in which the processor never waits for a GPU, shown on a device without values."""

import contextlib

import pytest
import torch
from torch import nn

from gpu.rows import photo_augmentation
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.configuration import build_prior
from hand_recon.training.module import HandReconstruction
from hand_recon.training.non_finite import LossGuard
from tests.support.configurations import composed
from tests.support.resident_hands import module_of, resident
from tests.support.without_values import META, nothing_is_copied


def module_for_photos(stage: int) -> HandReconstruction:
    """A small network with all that `recipe=photos` trains it with, in a stage of the data term."""
    module = module_of(5)
    settings = composed("recipe=photos", "prior.non_penetration.sizes=fixed")
    module.prior = build_prior(settings.prior, module.regressor.hand)
    if stage:
        module.data_term.begin(step=3, epoch=0, total_steps=4)
    return module.to(META)


@pytest.mark.parametrize("stage", [0, 1])
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
