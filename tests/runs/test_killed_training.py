"""Trainings that are killed and continued, against one that was not: losses and weights, bit for bit."""

import random
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.killed_training import (
    STEPS,
    Death,
    logged,
    other_entries,
    start,
    state,
    status,
)

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "SIGKILL"), reason="The system has no SIGKILL to be killed with."
)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def whole(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training that nobody interrupts."""
    folder = tmp_path_factory.mktemp("runs") / "train" / "whole"
    assert status(start(cache, folder)) == 0
    return folder


def assert_same(continued: Path, whole: Path) -> None:
    assert logged(continued) == logged(whole)
    assert not other_entries(continued, whole)


def test_a_training_killed_three_times_ends_bit_for_bit_like_one_that_was_not(
    cache: Path, whole: Path, tmp_path: Path
) -> None:
    """SIGKILL in the first stage, SIGTERM in the next epoch, SIGKILL in the stage of the likelihood.

    Checkpoints are of every third step, or the one after it if that ends an epoch, and of the first after a
    validation: 3, 6, 9, 11, 12, 16, 18.
    """
    runs = tmp_path / "train"
    deaths = (Death(5, signal.SIGKILL), Death(7, signal.SIGTERM), Death(17, signal.SIGKILL))
    for number, death in enumerate(deaths):
        code = status(start(cache, runs / str(number), "resume=auto", death=death))
        assert code == (143 if death.number == signal.SIGTERM else -signal.SIGKILL)
    # SIGTERM comes as step 7 begins, and is obeyed after it.
    assert state(runs / "1")["global_step"] == 8
    assert state(runs / "2")["global_step"] == 16
    last = runs / "2" / "checkpoints" / "last.ckpt"
    last.write_bytes(last.read_bytes()[:-5000])
    assert status(start(cache, runs / "end", "resume=auto")) == 0
    assert_same(runs / "end", whole)
    assert [(runs / str(n) / "continued.json").is_file() for n in range(3)] == [True] * 3
    assert not list(runs.glob("*/unfinished.json"))
    # Nothing is left to continue: the same command would begin anew, and a finished run has all its files.
    shutil.rmtree(runs / "2")
    assert status(start(cache, runs / "again", f"resume={runs / 'end'}")) == 0
    assert_same(runs / "again", whole)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_a_training_killed_at_any_step_ends_bit_for_bit_like_one_that_was_not(
    cache: Path, whole: Path, tmp_path: Path, seed: int
) -> None:
    draws = random.Random(seed)  # noqa: S311  # no cryptography
    number = draws.choice((signal.SIGKILL, signal.SIGTERM))
    death = Death(draws.randrange(STEPS), number)
    runs = tmp_path / "train"
    assert status(start(cache, runs / "killed", death=death)) in {143, -signal.SIGKILL}
    assert status(start(cache, runs / "end", "resume=auto")) == 0
    assert_same(runs / "end", whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        ("workers=1",),
        ("prior=adversarial", "data_term=mse"),
        ("++trainer.accumulate_grad_batches=2", "checkpoint.every_n_steps=1"),
        ("++trainer.val_check_interval=2", "trainer.check_val_every_n_epoch=1"),
        ("++trainer.limit_train_batches=3",),
        ("optimizer.schedule=null",),
    ],
)
def test_other_ways_to_train_are_continued_exactly_too(
    cache: Path, tmp_path: Path, overrides: tuple[str, ...]
) -> None:
    run: Callable[..., int] = lambda name, *more, **kind: status(  # noqa: E731
        start(cache, tmp_path / "train" / name, *overrides, *more, **kind)
    )
    assert run("whole") == 0
    assert run("killed", death=Death(4, signal.SIGKILL)) == -signal.SIGKILL
    assert run("end", f"resume={tmp_path / 'train' / 'killed'}") == 0
    assert_same(tmp_path / "train" / "end", tmp_path / "train" / "whole")
