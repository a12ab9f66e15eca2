"""The learning rate over a run."""

import pytest
import torch

from hand_recon.training.schedules import warmup_cosine


def learning_rates(total: int, steps: int) -> list[float]:
    optimizer = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=2.0)
    schedule = warmup_cosine(optimizer, total_steps=total, warmup_steps=10)
    seen = []
    for _ in range(steps):
        seen.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        schedule.step()
    return seen


def test_the_rate_rises_over_its_steps_and_falls_to_zero() -> None:
    seen = learning_rates(1000, 1001)
    assert seen[0] == pytest.approx(0.2)
    assert seen[9] == pytest.approx(2.0, rel=1e-3)
    assert seen[500] == pytest.approx(1.0)
    assert seen[1000] == pytest.approx(0.0, abs=1e-9)


def test_a_run_of_two_steps_never_reaches_the_full_rate() -> None:
    assert max(learning_rates(2, 2)) <= 0.2


def test_a_warm_up_of_no_steps_begins_at_the_full_learning_rate() -> None:
    optimizer = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=2.0)
    assert warmup_cosine(optimizer, total_steps=10, warmup_steps=0).get_last_lr() == [2.0]
    with pytest.raises(ValueError, match="expected 0, for no warm-up"):
        warmup_cosine(optimizer, total_steps=10, warmup_steps=-1)
