"""One training on one, two and three processes: scores, losses and weights; kills, errors, resuming."""

import csv
import json
import signal
from pathlib import Path

import pytest
import torch

from tests.support.killed_training import Death, logged, other_entries, start, state, status
from tests.support.trained_together import (
    UNEVEN,
    WITH_GRADIENT,
    Fault,
    gradient_difference,
    messages_of,
    scores,
    start_together,
)

GLOBAL_BATCH = 12
"""Hands of a step of all processes together."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def alone(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training in one process."""
    folder = tmp_path_factory.mktemp("runs") / "train" / "alone"
    assert (
        status(start(cache, folder, f"data.batch_size={GLOBAL_BATCH}", *UNEVEN, WITH_GRADIENT)) == 0
    )
    return folder


def statuses(cache: Path, folder: Path, count: int, *overrides: str) -> list[int]:
    return [status(one) for one in start_together(cache, folder, count, *overrides)]


def losses(folder: Path) -> dict[tuple[str, int], float]:
    with (folder / "csv" / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {
        (name, number): float(text)
        for number, row in enumerate(rows)
        for name, text in row.items()
        if text
    }


def assert_as_alone(together: Path, alone: Path) -> None:
    """Float tolerance: sums over a batch are in another order, in 12 optimizer steps."""
    assert gradient_difference(together, alone) < 1e-5
    assert scores(together) == pytest.approx(scores(alone), rel=5e-4, abs=5e-4)
    assert losses(together) == pytest.approx(losses(alone), rel=2e-4, abs=1e-6)
    one, other = state(together)["state_dict"], state(alone)["state_dict"]
    for name, weight in other.items():
        if isinstance(weight, torch.Tensor):
            torch.testing.assert_close(one[name], weight, rtol=1e-3, atol=1e-4)
    assert (together / "per_hand.csv").read_text().count("\n") == 12
    assert not list(together.parent.glob(f"{together.name}_of_*"))
    assert json.loads((together / "metrics.json").read_text())["hands_per_step"] == GLOBAL_BATCH


def test_two_processes_train_and_score_as_one_does_with_both_batches(
    cache: Path, alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "train" / "two"
    assert statuses(cache, folder, 2, "data.batch_size=6", *UNEVEN, WITH_GRADIENT) == [0, 0]
    assert_as_alone(folder, alone)


@pytest.mark.slow
def test_three_processes_train_and_score_as_one_does(
    cache: Path, alone: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "train" / "three"
    assert statuses(cache, folder, 3, "data.batch_size=4", *UNEVEN, WITH_GRADIENT) == [0, 0, 0]
    assert_as_alone(folder, alone)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("dying", [0, 1])
def test_two_processes_of_which_one_is_killed_go_on_bit_for_bit(
    cache: Path, tmp_path: Path, number: signal.Signals, dying: int
) -> None:
    """With hidden landmarks, in the second epoch; after SIGTERM to one, both end with status 143."""
    runs = tmp_path / "train"
    size = "data.batch_size=8"
    assert statuses(cache, runs / "whole", 2, size) == [0, 0]
    death = Death(7, number)
    killed = start_together(
        cache, runs / "killed", 2, size, "resume=auto", "wait_minutes=1", death=death, dying=dying
    )
    codes = [status(one) for one in killed]
    assert codes[dying] == (143 if number == signal.SIGTERM else -number)
    assert codes[1 - dying] == (143 if number == signal.SIGTERM else 1)
    assert state(runs / "killed")["global_step"] == (8 if number == signal.SIGTERM else 6)
    assert statuses(cache, runs / "end", 2, size, "resume=auto") == [0, 0]
    assert logged(runs / "end") == logged(runs / "whole")
    assert not other_entries(runs / "end", runs / "whole")
    assert (runs / "killed" / "continued.json").is_file()


@pytest.mark.slow
def test_an_error_in_one_process_ends_both(cache: Path, tmp_path: Path) -> None:
    folder = tmp_path / "train" / "broken"
    fault = (
        f"+callbacks.fault._target_={Fault.__module__}.Fault", "+callbacks.fault.step=3",
        "+callbacks.fault.rank=1",
    )  # fmt: skip
    assert statuses(cache, folder, 2, "data.batch_size=8", "wait_minutes=1", *fault) == [1, 1]
    messages = messages_of(folder.with_name("broken_of_1")).read_text()
    assert "The image of this process is damaged." in messages
