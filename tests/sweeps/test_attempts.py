"""A finished run is known by its results and settings; an interrupted one goes on beside itself."""

import os
from dataclasses import replace
from pathlib import Path

import torch

from hand_recon.runs.unfinished import MARK, lock
from hand_recon.sweeps.attempts import attempt_in_use, finished_attempt, next_attempt
from hand_recon.tables.member_record import MemberRecord, State, write_member
from tests.support.member_scripts import finished_run, member


def interrupted(folder: Path, settings: object, *, checkpoint: bool = True) -> Path:
    """A folder of a training that was killed."""
    folder.mkdir()
    (folder / MARK).write_text("{}")
    (folder / "config.yaml").write_text("seed: 0\n")
    write_member(folder, MemberRecord(State.KILLED, settings=settings))
    if checkpoint:
        (folder / "checkpoints").mkdir()
        torch.save({"weights": torch.zeros(3)}, folder / "checkpoints" / "last.ckpt")
    return folder


def test_a_run_with_results_and_the_same_settings_is_finished(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    assert finished_attempt(one) is None
    finished_run(one.folder)
    write_member(one.folder, MemberRecord(State.FINISHED, settings=one.settings))
    assert finished_attempt(one) == one.folder


def test_results_of_other_settings_or_without_an_end_do_not_count(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    finished_run(one.folder)
    write_member(one.folder, MemberRecord(State.FINISHED, settings=one.settings))
    assert finished_attempt(replace(one, settings={"overrides": ["seed=1"]})) is None
    (one.folder / MARK).write_text("{}")
    assert finished_attempt(one) is None


def test_a_run_of_another_command_is_finished_by_its_configuration(tmp_path: Path) -> None:
    one = replace(member(tmp_path, "0"), settings={"seed": 0})
    finished_run(one.folder)
    assert finished_attempt(one) == one.folder
    assert finished_attempt(replace(one, settings={"seed": 1})) is None


def test_the_first_attempt_is_in_the_runs_own_folder(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    attempt = next_attempt(one)
    assert attempt.folder == one.folder
    run = f"hydra.run.dir='{one.folder}'"
    assert attempt.overrides == ("seed=0", "hydra.mode=RUN", run)


def test_a_killed_training_goes_on_from_its_checkpoint_in_a_folder_beside_it(
    tmp_path: Path,
) -> None:
    one = member(tmp_path, "0", "seed=0")
    interrupted(one.folder, one.settings)
    attempt = next_attempt(one)
    assert attempt.folder == tmp_path / "0__2"
    assert f"resume='{one.folder}'" in attempt.overrides
    interrupted(attempt.folder, one.settings)
    third = next_attempt(one)
    assert third.folder == tmp_path / "0__3"
    assert f"resume='{attempt.folder}'" in third.overrides


def test_without_a_whole_checkpoint_of_the_same_settings_it_begins_anew(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    interrupted(one.folder, {"overrides": ["seed=7"]})
    assert not any(word.startswith("resume=") for word in next_attempt(one).overrides)
    two = member(tmp_path, "1", "seed=0")
    interrupted(two.folder, two.settings)
    last = two.folder / "checkpoints" / "last.ckpt"
    last.write_bytes(last.read_bytes()[:100])
    attempt = next_attempt(two)
    assert attempt.folder == tmp_path / "1__2"
    assert not any(word.startswith("resume=") for word in attempt.overrides)


def test_an_attempt_that_never_came_to_its_settings_uses_the_folder_again(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    one.folder.mkdir()
    write_member(one.folder, MemberRecord(State.FAILED, settings=one.settings))
    assert next_attempt(one).folder == one.folder


def test_commands_that_go_on_in_their_own_folder_keep_it(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0", verb="fit")
    interrupted(one.folder, one.settings)
    assert next_attempt(one).folder == one.folder
    write_member(one.folder, MemberRecord(State.FINISHED, settings=one.settings))
    assert finished_attempt(one) == one.folder


def test_a_killed_or_changed_evaluation_begins_anew_beside_itself(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "ckpt=a", verb="evaluate")
    one.folder.mkdir()
    write_member(one.folder, MemberRecord(State.FAILED, settings=one.settings))
    for name in ("output.txt", "error.txt", "evaluate.log"):
        (one.folder / name).touch()
    # It failed before it wrote anything.
    assert next_attempt(one).folder == one.folder
    (one.folder / "per_hand.csv").touch()
    attempt = next_attempt(one)
    assert attempt.folder == tmp_path / "0__2"
    assert not any(word.startswith("resume=") for word in attempt.overrides)
    finished_run(attempt.folder)
    write_member(attempt.folder, MemberRecord(State.FINISHED, settings=one.settings))
    assert finished_attempt(one) == attempt.folder
    changed = replace(one, settings={"overrides": ["ckpt=b"]})
    assert finished_attempt(changed) is None
    assert next_attempt(changed).folder == tmp_path / "0__3"


def test_a_changed_fit_begins_anew_beside_the_earlier_one(tmp_path: Path) -> None:
    """Unfinished or finished: its own folder would be refused."""
    one = member(tmp_path, "0", "seed=0", verb="fit")
    interrupted(one.folder, one.settings)
    changed = replace(one, settings={"overrides": ["seed=1"]})
    assert next_attempt(changed).folder == tmp_path / "0__2"
    (one.folder / MARK).unlink()
    write_member(one.folder, MemberRecord(State.FINISHED, settings=one.settings))
    assert next_attempt(changed).folder == tmp_path / "0__2"


def test_a_killed_repetition_of_a_run_begins_anew(tmp_path: Path) -> None:
    """from_run takes no other setting, and so no resume=."""
    one = member(tmp_path, "0", "from_run='outputs/train/a'")
    interrupted(one.folder, one.settings)
    attempt = next_attempt(one)
    assert attempt.folder == tmp_path / "0__2"
    assert not any(word.startswith("resume=") for word in attempt.overrides)
    two = member(tmp_path, "1", "from_run=null")
    interrupted(two.folder, two.settings)
    assert f"resume='{two.folder}'" in next_attempt(two).overrides


def test_a_run_that_another_process_goes_on_with_is_known_by_its_lock(tmp_path: Path) -> None:
    one = member(tmp_path, "0", "seed=0")
    one.folder.mkdir()
    assert attempt_in_use(one) is None
    begun, end = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        lock(one.folder)
        os.write(begun[1], b"x")
        os.read(end[0], 1)
        os._exit(0)
    os.read(begun[0], 1)
    assert attempt_in_use(one) == one.folder
    os.write(end[1], b"x")
    os.waitpid(child, 0)
    assert attempt_in_use(one) is None
