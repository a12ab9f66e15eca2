"""The learning-rate schedule and what a training step refuses."""

import pytest
import torch

from hand_recon.hand.model import HandModel
from hand_recon.knowledge.prior import Prior
from hand_recon.knowledge.ranges import load_ranges
from hand_recon.reconstructor import ImageEncoder, Reconstructor
from hand_recon.schema import HandBatch
from hand_recon.training import HandReconstruction, warmup_cosine
from hand_recon.uncertainty import SquaredError


def rates(total: int, steps: int) -> list[float]:
    optimizer = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=2.0)
    schedule = warmup_cosine(optimizer, total_steps=total, warmup_steps=10)
    seen = []
    for _ in range(steps):
        seen.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedule.step()
    return seen


def test_the_rate_rises_over_its_steps_and_falls_to_zero() -> None:
    seen = rates(1000, 1001)
    assert seen[0] == pytest.approx(0.2)
    assert seen[9] == pytest.approx(2.0, rel=1e-3)
    assert seen[500] == pytest.approx(1.0)
    assert seen[1000] == pytest.approx(0.0, abs=1e-9)


def test_a_run_of_two_steps_never_reaches_the_full_rate() -> None:
    assert max(rates(2, 2)) <= 0.2


@pytest.fixture
def module(hand: HandModel) -> HandReconstruction:
    encoder = ImageEncoder("mobilenet_v3_small", weights="none")
    return HandReconstruction(
        Reconstructor(encoder, hand, width=32),
        Prior(load_ranges("literature", hand.rest_angles)),
        SquaredError(),
        torch.optim.Adam,
    )


def batch(size: int = 64) -> HandBatch:
    return HandBatch(
        torch.rand(4, 3, size, size), torch.rand(4, 21, 2) * size,
        torch.ones(4, 21, dtype=torch.bool), torch.arange(4), ("a", "b", "c", "d"),
    )  # fmt: skip


def test_the_loss_is_the_data_term_and_the_weighted_prior(module: HandReconstruction) -> None:
    module.eval()
    hands = batch()
    losses = module.losses(hands, module(hands))
    expected = losses["data"] + 20_000 * losses["range_of_motion"] + 10 * losses["shape"]
    torch.testing.assert_close(losses["loss"], expected)
    residual = (module(hands).landmarks_2d - hands.landmarks_2d) * 224 / 64
    torch.testing.assert_close(losses["data"], residual.square().sum(dim=(1, 2)).mean())


def test_a_loss_that_is_no_number_stops_the_run_and_names_the_samples(
    module: HandReconstruction,
) -> None:
    hands = batch()
    hands.landmarks_2d[1, 3] = float("inf")
    with pytest.raises(FloatingPointError, match=r"not finite.*'a', 'b'"):
        module.training_step(hands, 0)
