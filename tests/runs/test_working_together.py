"""Work that the first process does for all, failures of one of them, and runs of another number."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hand_recon.command_line.launched import ALONE, Place
from hand_recon.processes import process_group
from hand_recon.runs.resuming import _check_processes
from hand_recon.runs.working_together import first_of_each_machine, from_first

SECOND = Place(1, 1, 2, 2, "torchrun")


class Exchange:
    """The exchange of two processes, of which this is one, and the other has given values.

    Args:
        rank: Number of this process.
        others: What the other process gives, one after another.
    """

    def __init__(self, rank: int, *others: object) -> None:
        self.rank, self.others = rank, list(others)
        self.given: list[object] = []

    def gathered(self, value: object, *, patient: bool = False) -> list[Any]:
        """Copies of both values, as of a message."""
        self.given.append(value)
        both = [pickle.loads(pickle.dumps(value)), self.others.pop(0)]  # noqa: S301
        return both if self.rank == 0 else both[::-1]


def exchange(monkeypatch: pytest.MonkeyPatch, rank: int, *others: object) -> Exchange:
    made = Exchange(rank, *others)
    monkeypatch.setattr(process_group, "gathered", made.gathered)
    monkeypatch.setattr(process_group, "rank", lambda: rank)
    return made


def test_the_first_process_keeps_its_result_and_the_other_gets_a_copy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = {"folder": Path("run")}
    exchange(monkeypatch, 0, (True, None))
    assert from_first(replace(SECOND, rank=0), lambda: result) is result
    exchange(monkeypatch, 1, (True, result))

    def never() -> dict[str, Path]:
        raise AssertionError

    assert from_first(SECOND, never) == result


def test_a_process_ends_quietly_where_another_has_the_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exchange(monkeypatch, 1, (False, None))
    with pytest.raises(SystemExit) as end:
        from_first(SECOND, lambda: None)
    assert end.value.code == 1


def test_a_process_with_an_error_tells_the_others_before_it_raises_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = exchange(monkeypatch, 0, (True, None))

    def broken() -> None:
        raise ValueError("No such folder.")

    with pytest.raises(ValueError, match="No such folder"):
        from_first(replace(SECOND, rank=0), broken)
    assert told.given == [(False, None)]


@pytest.mark.parametrize(("local_rank", "turn"), [(0, 0), (1, 1)])
def test_one_process_of_a_machine_goes_first(
    local_rank: int, turn: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = exchange(monkeypatch, local_rank, (True, None), (True, None))
    exchanges_before: list[int] = []
    place = replace(SECOND, rank=local_rank, local_rank=local_rank)
    assert first_of_each_machine(place, lambda: exchanges_before.append(len(told.given))) is None
    assert exchanges_before == [turn]


def test_alone_nothing_is_exchanged() -> None:
    result = object()
    assert from_first(ALONE, lambda: result) is result
    assert first_of_each_machine(ALONE, lambda: result) is result


def test_a_run_goes_on_with_as_many_processes_as_it_had() -> None:
    path = Path("run/checkpoints/last.ckpt")
    _check_processes(path, {"hand_recon_position": {"epoch": 1, "batches": 3, "processes": 2}}, 2)
    # Checkpoints from before there were several.
    _check_processes(path, {"hand_recon_position": {"epoch": 1, "batches": 3}}, 1)
    with pytest.raises(ValueError, match=r"by 2 processes, and now there are 3.*Continue with 2"):
        _check_processes(path, {"hand_recon_position": {"processes": 2}}, 3)
