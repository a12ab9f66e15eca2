"""Within a training, the scores of validations reach the search, and the pruner ends the training."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import lightning
import pytest

from hand_recon.sweeps.search import reporting
from hand_recon.sweeps.search.reporting import ReportToSearch
from hand_recon.sweeps.search.space import distributions
from hand_recon.sweeps.search.study import PRUNED, Searched, claim, open_study, states
from tests.support.killed_training import status
from tests.support.trained_together import UNEVEN, start_together

pytest.importorskip("optuna")

SEARCHED = Searched(
    space={"lr": {"low": 0.0, "high": 1.0}},
    objective="val/E_2D",
    direction="minimize",
    seed=0,
    sampler={"_target_": "optuna.samplers.TPESampler"},
    pruner={"_target_": "optuna.pruners.MedianPruner", "n_startup_trials": 1, "n_warmup_steps": 0},
    overrides=(),
)


def test_scores_are_reported_and_a_worse_trial_is_ended(tmp_path: Path) -> None:
    claim(tmp_path, SEARCHED)
    study = open_study(tmp_path)
    for _ in range(2):
        study.ask(fixed_distributions=distributions(SEARCHED.space))
    first, second = ReportToSearch(tmp_path, 0), ReportToSearch(tmp_path, 1)
    assert not first.tell(0, {"val/E_2D": 2.0})
    assert not first.tell(1, {"val/E_2D": 1.0})
    study.tell(0, 1.0)
    assert not second.tell(0, {"val/E_2D": 1.5})
    # A trial that goes on after a kill may come to an epoch twice: the first value counts.
    assert not second.tell(0, {"val/E_2D": 9.0})
    assert second.tell(1, {"val/E_2D": 3.0})
    one, two = states(open_study(tmp_path))
    assert one.intermediate_values == {0: 2.0, 1: 1.0}
    assert two.intermediate_values == {0: 1.5, 1: 3.0}
    assert two.user_attrs == {PRUNED: 1}


def test_an_objective_that_there_is_not_is_an_error_that_names_those_that_there_are(
    tmp_path: Path,
) -> None:
    claim(tmp_path, SEARCHED)
    open_study(tmp_path).ask(fixed_distributions=distributions(SEARCHED.space))
    with pytest.raises(ValueError, match=r"val/E_2D, which .* no score of\. Known: val/E_J\."):
        ReportToSearch(tmp_path, 0).tell(0, {"val/E_J": 1.0})


def trainer_of(scores: dict[str, float]) -> Mock:
    """A trainer after an epoch's validation."""
    return Mock(
        spec=lightning.Trainer, callback_metrics=scores, current_epoch=0, sanity_checking=False,
        should_stop=False,
    )  # fmt: skip


@pytest.fixture
def validated(monkeypatch: pytest.MonkeyPatch) -> Callable[[ReportToSearch, int, Mock], None]:
    """Runs the callback in one of two processes; what the first one gathers reaches the other."""
    sent: list[object] = []

    def validate(report: ReportToSearch, number: int, trainer: Mock) -> None:
        def gathered(value: object) -> list[object]:
            if number == 0:
                sent[:] = [value, None]
            return list(sent)

        monkeypatch.setattr(reporting, "rank", lambda: number)
        monkeypatch.setattr(reporting, "gathered", gathered)
        report.on_validation_end(trainer, Mock(spec=lightning.LightningModule))

    return validate


def test_the_verdict_of_the_first_process_ends_the_training_in_all(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    validated: Callable[[ReportToSearch, int, Mock], None],
) -> None:
    claim(tmp_path, SEARCHED)
    asked: list[float] = []

    def tell(self: ReportToSearch, epoch: int, scores: dict[str, float]) -> bool:
        asked.append(scores["val/E_2D"])
        return scores["val/E_2D"] > 1

    monkeypatch.setattr(ReportToSearch, "tell", tell)
    report = ReportToSearch(tmp_path, 0)
    for score in (0.5, 2.0):
        trainers = [trainer_of({"val/E_2D": score}) for _ in range(2)]
        for number, trainer in enumerate(trainers):
            validated(report, number, trainer)
        assert [trainer.should_stop for trainer in trainers] == [score > 1] * 2
    assert asked == [0.5, 2.0]


def test_an_error_of_the_first_process_is_one_of_all(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    validated: Callable[[ReportToSearch, int, Mock], None],
) -> None:
    """The others would wait for its verdict for ever."""
    claim(tmp_path, SEARCHED)
    report = ReportToSearch(tmp_path, 0)
    for number in (0, 1):
        with pytest.raises(ValueError, match=r"no score of\. Known: val/E_J"):
            validated(report, number, trainer_of({"val/E_J": 1.0}))

    def broken(*_: object) -> bool:
        raise KeyError("journal")

    monkeypatch.setattr(ReportToSearch, "tell", broken)
    for number in (0, 1):
        with pytest.raises(OSError, match="cannot be told a score: 'journal'"):
            validated(report, number, trainer_of({"val/E_J": 1.0}))


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["val/E_J", "val/unknown"])
def test_two_processes_of_a_pruned_trial_end_and_do_not_wait(
    tmp_path: Path, objective: str
) -> None:
    """After the first of two epochs; where the first process has an error, both have it."""
    above_zero = {"_target_": "optuna.pruners.ThresholdPruner", "upper": 0.0}
    claim(tmp_path, replace(SEARCHED, objective=objective, pruner=above_zero))
    open_study(tmp_path).ask(fixed_distributions=distributions(SEARCHED.space))
    folder = tmp_path / "train" / "two"
    report = (
        f"+callbacks.search._target_={ReportToSearch.__module__}.ReportToSearch",
        f"+callbacks.search.folder='{tmp_path}'", "+callbacks.search.trial=0",
    )  # fmt: skip
    words = (*UNEVEN, "trainer.check_val_every_n_epoch=1", "test=false", *report)
    processes = start_together(tmp_path / "cache", folder, 2, *words)
    known = objective == "val/E_J"
    assert [status(process) for process in processes] == ([0, 0] if known else [1, 1])
    (trial,) = states(open_study(tmp_path))
    assert trial.user_attrs == ({PRUNED: 0} if known else {})
    assert list(trial.intermediate_values) == ([0] if known else [])
