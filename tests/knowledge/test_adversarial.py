"""The discriminator: its losses by hand, its gradients, its training and its checkpoints."""

import copy

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.adversarial import (
    OUTPUTS,
    AdversarialTerm,
    Adversary,
    Discriminator,
    discriminator_loss,
    generator_loss,
)
from hand_recon.knowledge.prior import Prior
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
    made.set_real_hands(hands(200, bend=0.5, size=0.5))
    return made


def test_the_losses_are_squared_distances_summed_over_the_outputs() -> None:
    """Two hands, all outputs at 0.5 and at 3: (0.5 − 1)² · 17 = 4.25 and (3 − 1)² · 17 = 68."""
    scores = torch.tensor([0.5, 3.0])[:, None].expand(2, OUTPUTS)
    assert_close(generator_loss(scores), torch.tensor([4.25, 68.0]))
    # Real at 1 and predicted at 0 cost nothing; 0.2 too low and 0.1 too high: 17 · (0.04 + 0.01).
    ones, zeros = torch.ones(3, OUTPUTS), torch.zeros(2, OUTPUTS)
    assert discriminator_loss(ones, zeros).item() == 0.0
    assert_close(discriminator_loss(ones - 0.2, zeros + 0.1), torch.tensor(17 * 0.05))


def test_at_one_half_both_losses_are_a_quarter_per_output() -> None:
    """D = ½ for all hands is the equilibrium: ¼ + ¼ per output."""
    half = torch.full((4, OUTPUTS), 0.5)
    assert_close(discriminator_loss(half, half), torch.tensor(17 * 0.5))
    assert_close(generator_loss(half), torch.full((4,), 17 * 0.25))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_one_hand_is_scored_as_in_a_batch(shape: tuple[int, ...]) -> None:
    discriminator = Discriminator()
    angles, coefficients = torch.randn(*shape, 15, 3), torch.randn(*shape, 10)
    scores = discriminator(angles, coefficients)
    assert scores.shape == (*shape, OUTPUTS)
    flat = [
        discriminator(one, other)
        for one, other in zip(angles.reshape(-1, 15, 3), coefficients.reshape(-1, 10), strict=True)
    ]
    assert_close(scores.reshape(-1, OUTPUTS), torch.stack(flat))


def test_each_output_sees_its_own_part_alone() -> None:
    """Another angle at joint 4 changes its output and the pose's; another shape changes the shape's."""
    discriminator = Discriminator()
    angles, shape = torch.randn(15, 3), torch.randn(10)
    before = discriminator(angles, shape)
    other = angles.clone()
    other[4] += 0.5
    changed = (discriminator(other, shape) - before).abs() > 1e-6
    assert changed.nonzero().flatten().tolist() == [4, 15]
    changed = (discriminator(angles, shape + 1.0) - before).abs() > 1e-6
    assert changed.nonzero().flatten().tolist() == [16]


def test_a_full_rotation_changes_no_score() -> None:
    discriminator = Discriminator()
    angles, shape = torch.randn(5, 15, 3), torch.randn(5, 10)
    rotated = angles + 2 * torch.pi * torch.randint(-1, 2, (5, 15, 3))
    assert_close(discriminator(rotated, shape), discriminator(angles, shape))


def test_the_generator_loss_has_a_gradient_for_the_hand_alone(adversary: Adversary) -> None:
    predicted = hands(6)
    predicted.joint_angles.requires_grad_()
    predicted.shape.requires_grad_()
    adversary(predicted).sum().backward()
    for leaf in (predicted.joint_angles, predicted.shape):
        assert leaf.grad is not None
        assert (leaf.grad.flatten(1).abs().sum(dim=1) > 0).all()
    assert all(weight.grad is None for weight in adversary.parameters())
    assert not any(weight.requires_grad for weight in adversary.parameters())


def test_its_own_step_changes_the_discriminator_and_no_hand(adversary: Adversary) -> None:
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
    scores = adversary.discriminator
    # Every output, on hands that were not in the training.
    assert (scores(real.joint_angles, real.shape).mean(dim=0) > 0.7).all()
    assert (scores(straight.joint_angles, straight.shape).mean(dim=0) < 0.3).all()
    assert adversary(real).mean() < 0.25 * adversary(straight).mean()


def test_predicted_hands_are_drawn_to_the_real_ones(adversary: Adversary) -> None:
    """Free poses that descend on the generator loss become as bent and as large as the real hands."""
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


def test_a_restored_discriminator_goes_on_as_if_it_had_not_stopped(adversary: Adversary) -> None:
    """The optimizer's moments and the draw of real hands go on too, not the weights alone."""
    batches = [hands(8) for _ in range(6)]
    for batch in batches[:3]:
        adversary.learn(batch)
    again = Adversary(learning_rate=1e-3)
    again.load_state_dict(copy.deepcopy(adversary.state_dict()), strict=True)
    # A checkpoint of a run that was loaded and has not gone on loses nothing.
    again.load_state_dict(copy.deepcopy(again.state_dict()), strict=True)
    assert adversary._real is not None
    again.set_real_hands(adversary._real)
    for batch in batches[3:]:
        assert torch.equal(adversary.learn(batch), again.learn(batch))
    pairs = zip(adversary.parameters(), again.parameters(), strict=True)
    assert all(torch.equal(one, other) for one, other in pairs)


def test_its_real_hands_are_in_no_checkpoint(adversary: Adversary) -> None:
    state = adversary.state_dict()
    assert {name.partition(".")[0] for name in state} == {"discriminator", "_extra_state"}


def test_a_discriminator_that_has_seen_no_hand_is_refused(
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


def test_a_weight_of_zero_keeps_no_discriminator(hand: HandModel) -> None:
    prior = Prior({"adversarial": AdversarialTerm(hand, weight=0.0)})
    assert prior.state_dict() == {}
    assert list(prior.parameters()) == []


def test_the_term_is_the_generator_loss_times_its_weight(hand: HandModel) -> None:
    term = AdversarialTerm(hand, weight=3.0, learning_rate=1e-4)
    assert term.adversary.learning_rate == 1e-4
    term.adversary.set_real_hands(hands(50))
    prior = Prior({"adversarial": term})
    predicted = hands(4)
    values = prior(predicted)
    assert_close(values["adversarial"], term.adversary(predicted))
    assert_close(prior.weighted(values)["adversarial"], 3 * term.adversary(predicted))
