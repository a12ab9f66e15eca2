"""The report tells how the unfinished runs of a sweep have ended."""

from pathlib import Path

import pytest

from hand_recon.tables.member_record import MemberRecord, State, read_member, write_member
from hand_recon.tables.runs import LeftOut, read_run, run_folders


def reason(folder: Path) -> str:
    """Reason why a run is in no table."""
    run = read_run(folder)
    assert isinstance(run, LeftOut)
    return run.reason


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    record = MemberRecord(State.KILLED, ("seed=1",), {"seed": 1}, -9, 2.5, "ended by SIGKILL")
    write_member(tmp_path, record)
    assert read_member(tmp_path) == record


@pytest.mark.parametrize("text", ["", "[]", '{"state": "lost", "overrides": []}', '{"state": 1}'])
def test_a_damaged_record_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "member.json").write_text(text)
    assert read_member(tmp_path) is None


def test_a_failed_run_has_its_error_in_the_report(tmp_path: Path) -> None:
    folder = tmp_path / "0_seed-0"
    folder.mkdir()
    write_member(folder, MemberRecord(State.FAILED, error="ValueError: lr"))
    assert run_folders([tmp_path]) == [folder]
    assert reason(folder) == "failed: ValueError: lr"
    (tmp_path / "0_seed-0__2").mkdir()
    assert reason(folder) == "failed: ValueError: lr; run again in 0_seed-0__2"
    second = tmp_path / "0_seed-0__2"
    write_member(second, MemberRecord(State.KILLED))
    assert reason(second) == "killed, to be continued"
    (tmp_path / "0_seed-0__3").mkdir()
    assert reason(second) == "killed, to be continued; run again in 0_seed-0__3"


def test_a_run_that_goes_on_and_one_without_a_record_are_unfinished(tmp_path: Path) -> None:
    write_member(tmp_path, MemberRecord(State.RUNNING))
    assert reason(tmp_path) == "running"
    (tmp_path / "member.json").unlink()
    assert reason(tmp_path).startswith("unfinished")
