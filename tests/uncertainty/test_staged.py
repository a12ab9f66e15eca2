"""The schedule: one switch at the configured time, kept by checkpoints."""

import copy
import math

import pytest
import torch
from torch import Tensor

from hand_recon.uncertainty import (
    DataTerm,
    LaplaceLikelihood,
    NegativeLogLikelihood,
    RescaledSquaredError,
    SquaredError,
    Staged,
)
from hand_recon.uncertainty.staged import RUNNING_DECAY, RunningResidual
from tests.support.tolerance import BATCH_SHAPES, assert_close

STEPS_PER_EPOCH = 10


def paper(switch_at: float = 0.5, unit: str = "share") -> Staged:
    return Staged(SquaredError(), NegativeLogLikelihood(), switch_at=switch_at, unit=unit)


def everything(shape: tuple[int, ...]) -> Tensor:
    return torch.ones(*shape, 21, dtype=torch.bool)


def switches(term: Staged, steps: range, total_steps: int = 100) -> list[int]:
    """Steps before which the term reports its switch."""
    return [
        step
        for step in steps
        if term.begin(step=step, epoch=step // STEPS_PER_EPOCH, total_steps=total_steps)
    ]


@pytest.mark.parametrize(
    ("switch_at", "unit", "expected"),
    [
        (0.5, "share", 50),
        (0.07, "share", 7),
        (0.001, "share", 1),
        (0.999, "share", 100),
        (3, "epoch", 30),
        (37, "step", 37),
    ],
)
def test_it_switches_once_and_when_it_was_asked_to(
    switch_at: float, unit: str, expected: int
) -> None:
    assert switches(paper(switch_at, unit), range(120)) == [expected]


def test_before_the_switch_it_is_the_first_term_and_after_it_the_second() -> None:
    term, labelled = paper(), everything((3,))
    residual, log_sigma = torch.randn(3, 21, 2), torch.randn(3, 21, 2)
    assert (term.stage, term.stages) == (0, 2)
    assert_close(term(residual, log_sigma, labelled), SquaredError()(residual, log_sigma, labelled))
    assert term.begin(step=50, epoch=0, total_steps=100)
    assert term.stage == 1
    expected = NegativeLogLikelihood()(residual, log_sigma, labelled)
    assert_close(term(residual, log_sigma, labelled), expected)


def test_a_run_that_goes_on_does_not_switch_again_and_knows_its_stage() -> None:
    term = paper()
    term.observe(torch.full((4, 21, 2), 3.0), everything((4,)))
    assert switches(term, range(60)) == [50]
    resumed = paper()
    resumed.load_state_dict(copy.deepcopy(term.state_dict()))
    assert resumed.stage == 1
    assert switches(resumed, range(60, 100)) == []
    assert_close(resumed.running_log_sigma(), term.running_log_sigma())


def test_a_run_interrupted_before_the_switch_makes_it_in_time() -> None:
    term = paper()
    term.observe(torch.full((4, 21, 2), 3.0), everything((4,)))
    assert switches(term, range(30)) == []
    resumed = paper()
    resumed.load_state_dict(copy.deepcopy(term.state_dict()))
    resumed.observe(torch.full((4, 21, 2), 5.0), everything((4,)))
    assert switches(resumed, range(30, 100)) == [50]
    # (0.99 · 9 + 25) / 1.99: residuals from before the interruption count.
    expected = 0.5 * math.log((RUNNING_DECAY * 9 + 25) / (RUNNING_DECAY + 1))
    assert_close(resumed.running_log_sigma(), torch.full((21, 2), expected))


@pytest.mark.parametrize("shape", BATCH_SHAPES)
def test_the_running_residual_of_one_step_is_its_rms(shape: tuple[int, ...]) -> None:
    residual = torch.randn(*shape, 21, 2) * 10 + 20
    running = RunningResidual()
    running.update(residual, everything(shape))
    expected = residual.reshape(-1, 21, 2).square().mean(dim=0).sqrt().log()
    assert_close(running.log_sigma(), expected)


def test_the_running_residual_forgets_at_the_decay() -> None:
    """Two steps of 6 px, then one of 2 px: (0.99² · 36 + 0.99 · 36 + 4) / (0.99² + 0.99 + 1)."""
    running = RunningResidual()
    for size in (6.0, 6.0, 2.0):
        running.update(torch.full((8, 21, 2), size), everything((8,)))
    mean = (0.9801 * 36 + 0.99 * 36 + 4) / (0.9801 + 0.99 + 1)
    assert_close(running.log_sigma(), torch.full((21, 2), 0.5 * math.log(mean)))


def test_only_labelled_landmarks_are_observed_and_each_coordinate_by_itself() -> None:
    residual = torch.full((2, 21, 2), float("nan"))
    residual[0, 0] = torch.tensor([3.0, 4.0])
    residual[1, 0] = torch.tensor([5.0, 4.0])
    residual[0, 1] = torch.tensor([1.0, 2.0])
    term = paper()
    term.observe(residual.requires_grad_(), residual.isfinite().all(dim=-1))
    log_sigma = term.running_log_sigma()
    assert not log_sigma.requires_grad
    assert_close(log_sigma[0].exp(), torch.tensor([math.sqrt(17), 4.0]))
    assert_close(log_sigma[1].exp(), torch.tensor([1.0, 2.0]))
    # Landmarks without labels take the mean square of the six numbers that were seen.
    overall = math.sqrt((9 + 16 + 25 + 16 + 1 + 4) / 6)
    assert_close(log_sigma[2:].exp(), torch.full((19, 2), overall))


def test_a_perfect_fit_starts_at_half_a_pixel_and_not_at_zero() -> None:
    term = paper()
    term.observe(torch.zeros(2, 21, 2), everything((2,)))
    assert_close(term.running_log_sigma().exp(), torch.full((21, 2), 0.5))


def test_with_nothing_observed_sigma_starts_where_the_network_does() -> None:
    assert_close(paper().running_log_sigma(), torch.full((21, 2), 1.5))


def test_at_the_switch_the_pull_falls_by_just_two_sigma_squared() -> None:
    """With σ = running RMS, the gradient 2e becomes e / σ² and does not jump otherwise."""
    term, labelled = paper().double(), everything((16,))
    residual = (7 * torch.randn(16, 21, 2, dtype=torch.float64)).requires_grad_()
    term.observe(residual, labelled)
    log_sigma = term.running_log_sigma().expand(16, 21, 2)
    (before,) = torch.autograd.grad(term(residual, log_sigma, labelled).sum(), residual)
    assert term.begin(step=50, epoch=0, total_steps=100)
    (after,) = torch.autograd.grad(term(residual, log_sigma, labelled).sum(), residual)
    assert_close(before, 2 * residual.detach())
    assert_close(after, residual.detach() / torch.exp(2 * log_sigma))
    # The gradient of log σ, averaged over hands, is zero.
    leaf = log_sigma.clone().requires_grad_()
    (on_sigma,) = torch.autograd.grad(term(residual.detach(), leaf, labelled).sum(), leaf)
    assert_close(on_sigma.sum(dim=0), torch.zeros(21, 2))


def test_the_switch_gives_the_rescaled_error_the_running_residual() -> None:
    """Half the landmarks at 1 px and half at 7: σ̄² = (10 · 1 + 11 · 49) / 21."""
    second = RescaledSquaredError()
    term = Staged(SquaredError(), second, switch_at=0.5)
    residual = torch.ones(4, 21, 2)
    residual[:, 10:] = 7.0
    term.observe(residual, everything((4,)))
    assert term.begin(step=5, epoch=0, total_steps=10)
    assert float(second.sigma) == pytest.approx(math.sqrt((10 + 11 * 49) / 21))
    # The mean of e² / (2σ̄²) is ½ per coordinate, as under Eq. 7 with the best single σ.
    value = term(residual, torch.zeros(4, 21, 2), everything((4,)))
    assert_close(value, torch.full((4,), 21.0))
    resumed = Staged(SquaredError(), RescaledSquaredError(), switch_at=0.5)
    resumed.load_state_dict(term.state_dict())
    assert_close(resumed(residual, torch.zeros(4, 21, 2), everything((4,))), value)


def test_times_without_meaning_are_refused_with_a_cure() -> None:
    with pytest.raises(ValueError, match="one of share, epoch, step, found 'minutes'"):
        paper(unit="minutes")
    with pytest.raises(ValueError, match=r"leaves no first stage.*data_term=nll"):
        paper(0.0)
    with pytest.raises(ValueError, match=r"never comes.*unit=epoch or step"):
        paper(40)
    with pytest.raises(ValueError, match=r"no known end.*data_term.unit=epoch"):
        paper().begin(step=0, epoch=0, total_steps=-1)


def test_a_kept_balance_leaves_the_data_term_its_weight_against_the_prior() -> None:
    """For equal residuals, a gradient of 2e becomes 2σ² · e / σ², which is the same."""
    term = Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=True)
    labelled = everything((4,))
    term.observe(torch.full((4, 21, 2), 3.0), labelled)
    residual = torch.randn(4, 21, 2, requires_grad=True)
    (before,) = torch.autograd.grad(term(residual, torch.zeros(4, 21, 2), labelled).sum(), residual)
    assert term.begin(step=50, epoch=0, total_steps=100)
    log_sigma = term.running_log_sigma().expand(4, 21, 2)
    (after,) = torch.autograd.grad(term(residual, log_sigma, labelled).sum(), residual)
    assert_close(after, before)
    # Eq. 7 to the letter loses 1 / (2σ²) = 1/18 of it.
    assert_close(
        NegativeLogLikelihood()(residual, log_sigma, labelled),
        term(residual, log_sigma, labelled) / 18,
    )
    resumed = Staged(SquaredError(), NegativeLogLikelihood(), switch_at=0.5, keep_balance=True)
    resumed.load_state_dict(term.state_dict())
    assert_close(resumed(residual, log_sigma, labelled), term(residual, log_sigma, labelled))


@pytest.mark.parametrize(
    "second",
    [
        NegativeLogLikelihood(),
        NegativeLogLikelihood(beta=0.5),
        NegativeLogLikelihood(beta=1.0),
        LaplaceLikelihood(),
    ],
)
def test_a_kept_balance_leaves_the_mean_pull_of_the_labels_as_it_was(second: DataTerm) -> None:
    """Residuals of 8 px with σ at their RMS: the mean size of the gradient before and after the switch."""
    residual = (8 * torch.randn(400, 21, 2)).requires_grad_()
    labelled = torch.ones(400, 21, dtype=torch.bool)
    log_sigma = torch.full_like(residual, math.log(8.0))
    term = Staged(SquaredError(), second, switch_at=1, unit="step", keep_balance=True)
    pulls = []
    for step in (0, 1):
        term.observe(residual.detach(), labelled)
        term.begin(step=step, epoch=0, total_steps=2)
        (pull,) = torch.autograd.grad(term(residual, log_sigma, labelled).sum(), residual)
        pulls.append(float(pull.abs().mean()))
    assert pulls[1] == pytest.approx(pulls[0], rel=0.03)
