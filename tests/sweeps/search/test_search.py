"""A search asks, trains, tells, goes on after a kill, and has failed and pruned trials in its table."""

import csv
import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from hand_recon.sweeps import member_process
from hand_recon.sweeps.attempts import Member
from hand_recon.sweeps.member_process import Ended
from hand_recon.sweeps.places import Place
from hand_recon.sweeps.search import run as search_run
from hand_recon.sweeps.search.outcome import Outcome, write_outcome
from hand_recon.sweeps.search.run import Session
from hand_recon.sweeps.search.study import PRUNED, Searched, claim, open_study, states, trial_of

pytest.importorskip("optuna")

SEARCHED = Searched(
    space={"optimizer.lr": {"low": 0.0, "high": 1.0}},
    objective="val/E_J",
    direction="minimize",
    seed=0,
    sampler={"_target_": "optuna.samplers.TPESampler", "n_startup_trials": 3},
    pruner={"_target_": "optuna.pruners.MedianPruner", "n_startup_trials": 1, "n_warmup_steps": 0},
    overrides=("recipe=lifter",),
)


def rate_of(member: Member) -> float:
    """The learning rate of a trial's overrides."""
    word = next(word for word in member.overrides if word.startswith("optimizer.lr="))
    return float(word.partition("=")[2])


def trains(member: Member, place: Place) -> Ended:
    """A training whose validation score is the distance of the learning rate from 0.3."""
    assert "test=false" in member.overrides
    assert "recipe=lifter" in member.overrides
    member.folder.mkdir(parents=True)
    score = abs(rate_of(member) - 0.3)
    (member.folder / "metrics.json").write_text(json.dumps({"validation": {"E_J": score}}))
    return Ended(member.name, "finished", member.folder)


def session(folder: Path, trials: int) -> Session:
    """A search as far as this process goes on with it."""
    claim(folder, SEARCHED)
    return Session(folder, SEARCHED, trials)


def values(folder: Path) -> list[float]:
    """Learning rates of the trials, in their order."""
    return [one.params["optimizer.lr"] for one in states(open_study(folder))]


def test_the_best_trial_is_the_one_with_the_least_objective(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search_run, "run_member", trains)
    found = session(tmp_path, 12)
    found.run([Place()])
    best = write_outcome(Outcome(tmp_path, SEARCHED, states(found.study)))
    errors = [abs(rate - 0.3) for rate in values(tmp_path)]
    assert best["val/E_J"] == min(errors)
    assert best["trial"] == errors.index(min(errors))
    assert best["overrides"][0] == "recipe=lifter"
    assert best["trials"] == {"complete": 12}
    assert json.loads((tmp_path / "best.json").read_text()) == best
    with (tmp_path / "trials.csv").open() as stream:
        assert [row["state"] for row in csv.DictReader(stream)] == ["complete"] * 12
    assert (tmp_path / "search.png").read_bytes().startswith(b"\x89PNG")


def test_a_search_in_two_parts_proposes_what_one_in_one_part_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search_run, "run_member", trains)
    session(tmp_path / "whole", 8).run([Place()])
    session(tmp_path / "parts", 5).run([Place()])
    session(tmp_path / "parts", 8).run([Place()])
    assert values(tmp_path / "parts") == values(tmp_path / "whole")
    assert len(set(values(tmp_path / "whole"))) == 8


def test_a_failed_trial_is_recorded_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def some_fail(member: Member, place: Place) -> Ended:
        if member.name == "1":
            return Ended(member.name, "failed", member.folder, told="ValueError: too high")
        if member.name == "2":
            member.folder.mkdir()
            (member.folder / "metrics.json").write_text('{"validation": {"E_J": NaN}}')
            return Ended(member.name, "finished", member.folder)
        return trains(member, place)

    monkeypatch.setattr(search_run, "run_member", some_fail)
    found = session(tmp_path, 4)
    found.run([Place(), Place()])
    assert [one.state.name for one in states(found.study)] == [
        "COMPLETE",
        "FAIL",
        "FAIL",
        "COMPLETE",
    ]
    best = write_outcome(Outcome(tmp_path, SEARCHED, states(found.study)))
    assert best["trials"] == {"complete": 2, "fail": 2}
    with (tmp_path / "trials.csv").open() as stream:
        notes = [row["note"] for row in csv.DictReader(stream)]
    assert notes == ["", "ValueError: too high", "no finite val/E_J", ""]


def test_a_trial_that_was_running_at_a_kill_goes_on_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(member_process, "_ending", threading.Event())

    def killed_at_two(member: Member, place: Place) -> Ended:
        if member.name == "2":
            member_process.end_all()
            return Ended(member.name, "killed", member.folder, told="ended by SIGTERM")
        return trains(member, place)

    monkeypatch.setattr(search_run, "run_member", killed_at_two)
    first = session(tmp_path, 4)
    first.run([Place()])
    assert [one.state.name for one in states(first.study)] == ["COMPLETE", "COMPLETE", "RUNNING"]
    rate = values(tmp_path)[2]
    monkeypatch.setattr(member_process, "_ending", threading.Event())
    monkeypatch.setattr(search_run, "run_member", trains)
    again = session(tmp_path, 4)
    again.run([Place()])
    assert [one.state.name for one in states(again.study)] == ["COMPLETE"] * 4
    assert values(tmp_path)[2] == rate


@pytest.mark.parametrize("places", [1, 2])
def test_an_error_beside_those_of_trials_ends_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, places: int
) -> None:
    """It is raised after the end of the other trials, which get a signal, and goes on with them later."""
    monkeypatch.setattr(member_process, "_ending", threading.Event())

    def full_disk(member: Member, place: Place) -> Ended:
        if member.name == "0":
            raise OSError("The disk is full")
        assert member_process._ending.wait(20)
        return Ended(member.name, "killed", member.folder, told="ended by SIGTERM")

    monkeypatch.setattr(search_run, "run_member", full_disk)
    found = session(tmp_path, 4)
    with pytest.raises(OSError, match="The disk is full"):
        found.run([Place()] * places)
    assert {one.state.name for one in states(found.study)} == {"RUNNING"}
    assert len(states(found.study)) <= places


def test_ctrl_c_ends_the_trials_and_waits_for_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(member_process, "_ending", threading.Event())
    join, saved = threading.Thread.join, []

    def interrupted(thread: threading.Thread, timeout: float | None = None) -> None:
        monkeypatch.setattr(threading.Thread, "join", join)
        raise KeyboardInterrupt

    def saves(member: Member, place: Place) -> Ended:
        if member_process._ending.wait(20):
            saved.append(member.name)
        return Ended(member.name, "killed", member.folder, told="ended by SIGTERM")

    monkeypatch.setattr(search_run, "run_member", saves)
    found = session(tmp_path, 4)
    monkeypatch.setattr(threading.Thread, "join", interrupted)
    with pytest.raises(KeyboardInterrupt):
        found.run([Place()])
    assert saved == ["0"]
    assert [one.state.name for one in states(found.study)] == ["RUNNING"]


def test_a_trial_that_the_pruner_ended_is_pruned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reports(member: Member, place: Place) -> Ended:
        # The second trial is worse at the first epoch than the first one.
        trial = trial_of(open_study(tmp_path), int(member.name))
        trial.report(1.0 + int(member.name), 0)
        if trial.should_prune():
            trial.set_user_attr(PRUNED, 0)
        return trains(member, place)

    monkeypatch.setattr(search_run, "run_member", reports)
    found = session(tmp_path, 2)
    found.run([Place()])
    assert [one.state.name for one in states(found.study)] == ["COMPLETE", "PRUNED"]


def test_a_search_without_a_good_trial_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = Ended("0", "failed", tmp_path, told="ValueError: no data")
    monkeypatch.setattr(search_run, "run_member", lambda member, place: failed)
    found = session(tmp_path, 1)
    found.run([Place()])
    with pytest.raises(
        ValueError, match=r"None of 1 trials has ended well\. Trial 0: ValueError: no d"
    ):
        write_outcome(Outcome(tmp_path, SEARCHED, states(found.study)))


def test_scores_of_test_hands_and_settings_named_twice_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"search\.objective=test/E_J; expected a score of the valid"
    ):
        replace(SEARCHED, objective="test/E_J")
    with pytest.raises(ValueError, match=r"optimizer\.lr is given, and is in the search space"):
        replace(SEARCHED, overrides=("optimizer.lr=1",))


def test_a_folder_of_a_search_with_other_settings_is_refused(tmp_path: Path) -> None:
    claim(tmp_path, SEARCHED)
    claim(tmp_path, SEARCHED)
    with pytest.raises(FileExistsError, match=r"other settings \(seed was 0, is 1\)"):
        claim(tmp_path, replace(SEARCHED, seed=1))
