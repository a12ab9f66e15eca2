"""The record of one run of a sweep, in the run's folder: its state, exit status, time and error."""

import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from hand_recon.data.whole_files import replaced_when_whole

MEMBER_FILE: Final = "member.json"
"""File of the record."""

ERROR_FILE: Final = "error.txt"
"""File of a failed run: the message in the first line, then where it came from."""

OUTPUT_FILE: Final = "output.txt"
"""File of everything that the run printed."""


class State(StrEnum):
    """State of a run of a sweep."""

    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"
    KILLED = "killed"


@dataclass(frozen=True)
class MemberRecord:
    """A run of a sweep, as its folder tells it."""

    state: State
    """State when the record was written; `running` after a power cut, too."""
    overrides: tuple[str, ...] = ()
    """Overrides of the configuration, in Hydra's grammar."""
    settings: Any = None
    """Settings that the results depend on, as JSON holds them."""
    status: int | None = None
    """Exit status of the process; minus the signal that ended it."""
    seconds: float | None = None
    """Wall time of the process."""
    error: str | None = None
    """First line of the error."""

    @property
    def told(self) -> str:
        """State in words, with the error."""
        told = "killed, to be continued" if self.state == State.KILLED else str(self.state)
        return f"{told}: {self.error}" if self.error else told


def read_member(folder: Path) -> MemberRecord | None:
    """Read the record of a run; None if there is none, or a damaged one."""
    try:
        content = json.loads((folder / MEMBER_FILE).read_text(encoding="utf-8"))
        overrides = tuple(content.pop("overrides"))
        return MemberRecord(State(content.pop("state")), overrides, **content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def write_member(folder: Path, record: MemberRecord) -> None:
    """Write the record of a run in the place of an earlier one."""
    with replaced_when_whole(folder / MEMBER_FILE) as unfinished:
        unfinished.write_text(json.dumps(asdict(record), indent=1) + "\n", encoding="utf-8")


def described(status: int) -> str:
    """An exit status in words.

    >>> described(-9)
    'ended by SIGKILL'
    >>> described(143)
    'ended by SIGTERM'
    >>> described(1)
    'exit status 1'
    """
    number = -status if status < 0 else status - 128
    names = {2: "SIGINT", 6: "SIGABRT", 9: "SIGKILL", 11: "SIGSEGV", 15: "SIGTERM"}
    if number > 0:
        return f"ended by {names.get(number, f'signal {number}')}"
    return f"exit status {status}"
