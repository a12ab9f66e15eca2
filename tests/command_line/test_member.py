"""A run of a sweep as a process: its call as one word, its cores, the file of its error."""

import os
from pathlib import Path

import pytest

from hand_recon.command_line import member
from hand_recon.command_line.member import Call, main, take_cores


def test_a_call_comes_through_its_command_line_unchanged() -> None:
    call = Call("train", "train", ("seed=1", "photos.train='a b\"ü'"), (0, 3), "/x/error.txt")
    assert Call.from_json(call.words()[-1]) == call


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no CPU affinity")
def test_a_process_keeps_to_its_cores() -> None:
    mine = os.sched_getaffinity(0)
    try:
        take_cores((min(mine),))
        assert os.sched_getaffinity(0) == {min(mine)}
    finally:
        os.sched_setaffinity(0, mine)


def test_the_file_of_an_error_begins_with_its_message_and_goes_on_with_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(verb: str, config_name: str, overrides: tuple[str, ...]) -> None:
        try:
            raise ValueError("no such\nthing")
        except ValueError as error:
            raise SystemExit(1) from error

    monkeypatch.setattr(member, "run_overrides", fails)
    file = tmp_path / "error.txt"
    with pytest.raises(SystemExit):
        main(Call("train", "train", (), (), str(file)).words()[-1])
    lines = file.read_text().splitlines()
    assert lines[0] == "ValueError: no such thing"
    assert "Traceback (most recent call last):" in lines
    assert any("in fails" in line for line in lines)


@pytest.mark.parametrize("status", [0, 143])
def test_an_end_without_an_error_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    def ends(verb: str, config_name: str, overrides: tuple[str, ...]) -> None:
        raise SystemExit(status)

    monkeypatch.setattr(member, "run_overrides", ends)
    with pytest.raises(SystemExit):
        main(Call("train", "train", (), (), str(tmp_path / "error.txt")).words()[-1])
    assert not (tmp_path / "error.txt").exists()
