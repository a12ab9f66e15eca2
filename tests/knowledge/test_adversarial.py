"""A discriminator: losses by hand, whom its gradient reaches, what it learns, and what a checkpoint keeps."""

import copy
from collections.abc import Callable

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.adversarial import (
    JUDGES,
    Adversary,
    Discriminator,
    judged_loss,
    judges_loss,
)
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.schema import HandParameters
from tests.support.tolerance import BATCH_SHAPES, assert_close


def hands(count: int, bend: float = 0.0, size: float = 0.0) -> HandParameters:
    """Hands bent about so much at every joint and of about such a size."""
    angles = 0.1 * torch.randn(count, 15, 3)
    angles[..., 0] += bend
    shape = 0.1 * torch.randn(count, 10) + size
    return HandParameters(angles, shape, torch.eye(3).expand(count, 3, 3), torch.zeros(count, 3))


@pytest.fixture
def adversary() -> Adversary:
    made = Adversary(learning_rate=1e-3)
    made.meet(hands(200, bend=0.5, size=0.5))
    return made


def test_the_losses_are_squared_distances_summed_over_the_judges() -> None:
    """Two hands, all judges at 0.5 and at 3: (0.5 − 1)² · 17 = 4.25 and (3 − 1)² · 17 = 68."""
    judgement = torch.tensor([0.5, 3.0])[:, None].expand(2, JUDGES)
    assert_close(judged_loss(judgement), torch.tensor([4.25, 68.0]))
    # Real at 1 and predicted at 0 cost nothing; 0.2 too low and 0.1 too high: 17 · (0.04 + 0.01).
    ones, zeros = torch.ones(3, JUDGES), torch.zeros(2, JUDGES)
    assert judges_loss(ones, zeros).item() == 0.0
    assert_close(judges_loss(ones - 0.2, zeros + 0.1), torch.tensor(17 * 0.05))


def test_judges_that_cannot_tell_both_pay_a_quarter_each() -> None:
    """At ½ for everything: ¼ + ¼ per judge, the value where the game has its balance."""
    half = torch.full((4, JUDGES), 0.5)
    assert_close(judges_loss(half, half), torch.tensor(17 * 0.5))
    assert_close(judged_loss(half), torch.full((4,), 17 * 0.25))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_one_hand_is_judged_as_in_a_batch(shape: tuple[int, ...]) -> None:
    discriminator = Discriminator()
    angles, coefficients = torch.randn(*shape, 15, 3), torch.randn(*shape, 10)
    judged = discriminator(angles, coefficients)
    assert judged.shape == (*shape, JUDGES)
    flat = [
        discriminator(one, other)
        for one, other in zip(angles.reshape(-1, 15, 3), coefficients.reshape(-1, 10), strict=True)
    ]
    assert_close(judged.reshape(-1, JUDGES), torch.stack(flat))


def test_each_judge_sees_its_own_part_alone() -> None:
    """Another angle at joint 4 changes its judge and the pose's; another shape changes the shape's."""
    discriminator = Discriminator()
    angles, shape = torch.randn(15, 3), torch.randn(10)
    before = discriminator(angles, shape)
    other = angles.clone()
    other[4] += 0.5
    changed = (discriminator(other, shape) - before).abs() > 1e-6
    assert changed.nonzero().flatten().tolist() == [4, 15]
    changed = (discriminator(angles, shape + 1.0) - before).abs() > 1e-6
    assert changed.nonzero().flatten().tolist() == [16]


def test_a_full_turn_changes_no_judgement() -> None:
    discriminator = Discriminator()
    angles, shape = torch.randn(5, 15, 3), torch.randn(5, 10)
    turned = angles + 2 * torch.pi * torch.randint(-1, 2, (5, 15, 3))
    assert_close(discriminator(turned, shape), discriminator(angles, shape))


def test_a_judged_hand_gets_a_gradient_and_its_judge_none(adversary: Adversary) -> None:
    predicted = hands(6)
    predicted.joint_angles.requires_grad_()
    predicted.shape.requires_grad_()
    adversary(predicted).sum().backward()
    for leaf in (predicted.joint_angles, predicted.shape):
        assert leaf.grad is not None
        assert (leaf.grad.flatten(1).abs().sum(dim=1) > 0).all()
    assert all(weight.grad is None for weight in adversary.parameters())
    assert not any(weight.requires_grad for weight in adversary.parameters())


def test_its_own_step_changes_the_judge_and_no_hand(adversary: Adversary) -> None:
    predicted = hands(6)
    predicted.joint_angles.requires_grad_()
    before = copy.deepcopy(list(adversary.parameters()))
    adversary.learn(predicted)
    assert predicted.joint_angles.grad is None
    pairs = zip(before, adversary.parameters(), strict=True)
    assert all(not torch.equal(old, new) for old, new in pairs)
    assert not any(weight.requires_grad for weight in adversary.parameters())


def test_it_learns_to_tell_two_kinds_of_hands_apart(adversary: Adversary) -> None:
    """Real hands are bent by 0.5 rad and half a deviation large, predicted ones straight and average."""
    untrained = adversary.learn(hands(64))
    for _ in range(150):
        last = adversary.learn(hands(64))
    assert last < 0.2 * untrained
    real, straight = hands(100, bend=0.5, size=0.5), hands(100)
    judge = adversary.discriminator
    # Every judge, on hands that it has not seen.
    assert (judge(real.joint_angles, real.shape).mean(dim=0) > 0.7).all()
    assert (judge(straight.joint_angles, straight.shape).mean(dim=0) < 0.3).all()
    assert adversary(real).mean() < 0.25 * adversary(straight).mean()


def test_what_is_judged_is_drawn_to_the_real_hands(adversary: Adversary) -> None:
    """Free poses that descend on the judgement become as bent and as large as the real hands."""
    free = hands(64)
    leaves = [free.joint_angles.requires_grad_(), free.shape.requires_grad_()]
    optimizer = torch.optim.Adam(leaves, lr=0.01)
    for _ in range(100):
        adversary.learn(free)
        optimizer.zero_grad()
        adversary(free).sum().backward()
        optimizer.step()
    # The game circles its balance, so not to the last digit.
    assert 0.3 < float(free.joint_angles[..., 0].mean().detach()) < 0.8
    assert 0.3 < float(free.shape.mean().detach()) < 0.8


def test_a_restored_judge_goes_on_as_if_it_had_not_stopped(adversary: Adversary) -> None:
    """The optimizer's moments and the draw of real hands go on too, not the weights alone."""
    batches = [hands(8) for _ in range(6)]
    for batch in batches[:3]:
        adversary.learn(batch)
    again = Adversary(learning_rate=1e-3)
    again.load_state_dict(copy.deepcopy(adversary.state_dict()), strict=True)
    # A checkpoint of a run that was loaded and has not gone on loses nothing.
    again.load_state_dict(copy.deepcopy(again.state_dict()), strict=True)
    assert adversary._real is not None
    again.meet(adversary._real)
    for batch in batches[3:]:
        assert torch.equal(adversary.learn(batch), again.learn(batch))
    pairs = zip(adversary.parameters(), again.parameters(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)


def test_its_real_hands_are_in_no_checkpoint(adversary: Adversary) -> None:
    state = adversary.state_dict()
    assert {name.partition(".")[0] for name in state} == {"discriminator", "_extra_state"}


def test_a_judge_that_has_seen_no_hand_is_refused(
    adversary: Adversary, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with pytest.raises(ValueError, match=r"has seen no hand.*hand_recon\.train"):
        Adversary()(hands(2))
    with pytest.raises(ValueError, match="no real hands"):
        Adversary().learn(hands(2))
    adversary.learn(hands(2))
    trained = Adversary()
    trained.load_state_dict(adversary.state_dict())
    assert_close(trained(hands(2).detach()).isfinite().float(), torch.ones(2))


@pytest.fixture
def made(hand: HandModel) -> Callable[..., Prior]:
    ranges = load_ranges("literature", hand.rest_angles)
    return lambda **settings: Prior(ranges, hand, range_of_motion=0.0, **settings)


def test_a_weight_of_zero_makes_no_judge(made: Callable[..., Prior]) -> None:
    prior = made(adversary=Adversary())
    assert prior.adversary is None
    assert prior.state_dict() == {}
    assert list(prior.parameters()) == []


def test_a_priors_term_is_the_judgement_times_its_weight(
    made: Callable[..., Prior], adversary: Adversary, hand: HandModel
) -> None:
    prior = made(adversarial=3.0, adversary=adversary)
    assert prior.adversary is adversary
    terms = {"adversarial": adversary(hands(4))}
    assert_close(prior.weighted(terms)["adversarial"], 3 * terms["adversarial"])
