"""Rows and networks for training without Hydra: the same as the configuration's, on any device."""

from dataclasses import asdict

import pytest
import torch
from torch import nn

from gpu.rows import (
    CLIP,
    ROWS,
    WEIGHT_DECAY,
    WholeBatch,
    data_term_of_row,
    module_of_row,
    photo_augmentation,
    photo_network,
    prior_of_row,
)
from gpu.train import parser
from gpu.training import Plan
from hand_recon.hand.model import HandModel
from hand_recon.hand.open_hand import open_hand
from hand_recon.knowledge.penetration.non_penetration import NonPenetration
from hand_recon.knowledge.terms import Term
from hand_recon.runs.configuration import build_prior, instantiate
from hand_recon.uncertainty import DataTerm
from tests.support.configurations import composed
from tests.support.tolerance import assert_close
from tests.support.views import known_hands


def plain_settings(module: nn.Module) -> dict[str, object]:
    """Attributes of a module that are no tensors or modules, without those of `nn.Module`."""
    own = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    return {name: value for name, value in own.items() if name not in ("training", "hand")}


def settings_by_place(module: nn.Module) -> dict[str, object]:
    """Class and plain settings of a module and of all modules in it, by their names."""
    return {
        name: (type(part).__name__, plain_settings(part)) for name, part in module.named_modules()
    }


@pytest.mark.parametrize("row", ROWS)
def test_priors_are_those_of_the_configuration(hand: HandModel, row: int) -> None:
    expected = build_prior(composed(f"experiment=ablation_row{row}").prior, hand)
    found = prior_of_row(row, hand)
    assert found.weights == expected.weights
    for name, term in found.terms.items():
        wanted = expected.terms[name]
        assert isinstance(term, Term)
        assert isinstance(wanted, Term)
        assert type(term) is type(wanted)
        assert settings_by_place(term) == settings_by_place(wanted)
        for (place, buffer), (_, other) in zip(
            term.named_buffers(), wanted.named_buffers(), strict=True
        ):
            assert torch.equal(buffer, other), place


@pytest.mark.parametrize("row", ROWS)
def test_data_terms_are_those_of_the_configuration(row: int) -> None:
    expected: DataTerm = instantiate(composed(f"experiment=ablation_row{row}").data_term)
    assert settings_by_place(data_term_of_row(row)) == settings_by_place(expected)


def test_there_is_no_row_beyond_the_table(hand: HandModel) -> None:
    with pytest.raises(ValueError, match=r"rows \[1, 2, 3, 4, 5\], found 6"):
        prior_of_row(6, hand)


def test_the_network_is_that_of_the_recipe_for_photographs() -> None:
    config = composed(
        "recipe=photos_table1", "model.encoder.weights=none", "photos.train=labels.json"
    )
    hand = open_hand("mediapipe")
    expected = instantiate(config.model, hand=hand)
    frozen = config.model.encoder.frozen
    found = photo_network(hand, "efficientnet_lite0", "none", frozen=frozen)
    assert str(found) == str(expected)
    assert settings_by_place(found.encoder) == settings_by_place(expected.encoder)
    for name in ("iterations", "use_intrinsics", "sizes"):
        assert getattr(found, name) == getattr(expected, name)
    assert [p.requires_grad for p in found.parameters()] == [
        p.requires_grad for p in expected.parameters()
    ]


def test_augmentation_and_optimizer_are_those_of_the_recipe(hand: HandModel) -> None:
    config = composed("recipe=photos_table1", "photos.train=labels.json")
    expected = instantiate(config.data.augmentation)
    assert asdict(photo_augmentation()) == asdict(expected)
    shares = config.data.weights
    assert Plan(seconds=1.0).rendered_share == shares.rendered / sum(shares.values())
    assert config.data.parts.rendered.level == parser().get_default("level")
    assert config.trainer.gradient_clip_val == CLIP
    assert config.optimizer.weight_decay == WEIGHT_DECAY
    network = photo_network(hand, "efficientnet_lite0", "none", frozen=0)
    module = module_of_row(1, network, learning_rate=1e-3, on_gpu=False)
    optimizer = module.optimizer(module.parameters())
    assert type(optimizer).__name__ == config.optimizer._target_.rpartition(".")[-1]
    assert (optimizer.defaults["lr"], optimizer.defaults["fused"]) == (config.optimizer.lr, True)
    assert module.located_weight == config.located_weight


def test_non_penetration_of_a_whole_batch_has_the_same_value_and_gradient(hand: HandModel) -> None:
    """More hands than `NonPenetration` takes at once, fists among them."""
    known = known_hands(hand, 70)
    angles = known.joint_angles.clone()
    angles[::2, :, 0] += 0.8
    vertices = hand(angles, known.shape).vertices.detach()
    found = []
    for term in (NonPenetration(hand), WholeBatch(hand, at_once=1 << 20)):
        moved = vertices.clone().requires_grad_()
        value = term(moved)
        value.sum().backward()
        assert moved.grad is not None
        found.append((value.detach(), moved.grad))
    assert float(found[0][0].amax()) > 0
    assert_close(found[1][0], found[0][0])
    assert_close(found[1][1], found[0][1])
