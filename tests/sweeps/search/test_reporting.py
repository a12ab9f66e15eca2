"""Within a training, the scores of validations reach the search, and the pruner ends the training."""

from pathlib import Path

import pytest

from hand_recon.sweeps.search.reporting import ReportToSearch
from hand_recon.sweeps.search.space import distributions
from hand_recon.sweeps.search.study import PRUNED, Searched, claim, open_study, states

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
