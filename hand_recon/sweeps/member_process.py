"""Runs a member of a sweep in a process of its own, and notes in its folder how that ended."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Final

from hand_recon.command_line.member import Call
from hand_recon.sweeps.attempts import Attempt, Member, next_attempt
from hand_recon.sweeps.places import Place
from hand_recon.tables.member_record import (
    ERROR_FILE,
    OUTPUT_FILE,
    MemberRecord,
    State,
    described,
    write_member,
)

LAST_LINES: Final = 20
"""Lines of the output in the file of an error without a traceback."""

_running: Final[set[subprocess.Popen[bytes]]] = set()
_lock: Final = threading.Lock()
_ending: Final = threading.Event()


@dataclass(frozen=True)
class Ended:
    """A run of a sweep that has ended, or that was not started."""

    name: str
    """Name of the run for people."""
    state: str
    """State in a word: `finished`, `skipped`, `failed`, `killed` or `in use`."""
    folder: Path
    """Folder of the last attempt."""
    seconds: float | None = None
    """Wall time of this attempt."""
    told: str = ""
    """The error, or what was continued."""

    @property
    def good(self) -> bool:
        """True if the results are there."""
        return self.state in (State.FINISHED, "skipped")


def run_member(member: Member, place: Place) -> Ended:
    """Run a member to its end; nothing that happens to it is an error here.

    Args:
        member: The run.
        place: Its cores and GPU.
    """
    attempt = next_attempt(member)
    attempt.folder.mkdir(parents=True, exist_ok=True)
    record = MemberRecord(State.RUNNING, member.overrides, member.settings)
    write_member(attempt.folder, record)
    started = time.monotonic()
    status = _run(member, attempt, place)
    record = replace(record, status=status, seconds=round(time.monotonic() - started, 1))
    record = replace(record, state=_state(status), error=_error(attempt.folder, status))
    write_member(attempt.folder, record)
    continued = next((word for word in attempt.overrides if word.startswith("resume=")), "")
    told = record.error or (f"continued from {Path(continued[8:-1]).name}" if continued else "")
    return Ended(member.name, record.state, attempt.folder, record.seconds, told)


def end_all() -> None:
    """Send SIGTERM to every running member, which saves a checkpoint, and start no more."""
    _ending.set()
    # Without the lock, which the code that a signal interrupts may hold.
    for process in tuple(_running):
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGTERM)


def wait_for_all(seconds: float) -> bool:
    """Wait until every member's process has ended; false if some have not.

    It may be called in a signal's handler while `run_member` waits: the exit status is left to that.

    Args:
        seconds: Longest wait.
    """
    until = time.monotonic() + seconds
    running = [process.pid for process in _running]
    while running and time.monotonic() < until:
        running = [pid for pid in running if not _has_ended(pid)]
        time.sleep(0.05 if running else 0)
    return not running


def _has_ended(pid: int) -> bool:
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return True


def is_ending() -> bool:
    """True after `end_all`."""
    return _ending.is_set()


def _run(member: Member, attempt: Attempt, place: Place) -> int:
    error = attempt.folder / ERROR_FILE
    words = Call(
        member.verb, member.config_name, attempt.overrides, place.cores, str(error.absolute())
    ).words()
    error.unlink(missing_ok=True)
    with (attempt.folder / OUTPUT_FILE).open("ab") as output:
        process = _started(words, place, output)
        if process is None:
            return 128 + signal.SIGTERM
        try:
            return process.wait()
        finally:
            with _lock:
                _running.discard(process)


def _started(words: list[str], place: Place, output: IO[bytes]) -> subprocess.Popen[bytes] | None:
    """Start a process; None if the sweep is ending."""
    with _lock:
        if _ending.is_set():
            return None
        process = subprocess.Popen(  # noqa: S603  # our own program
            words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=place.environment()
        )
        _running.add(process)
        if _ending.is_set():
            # The signal came while it started.
            process.terminate()
        return process


def _state(status: int) -> State:
    if status == 0:
        return State.FINISHED
    killed = status < 0 or status in (128 + signal.SIGTERM, 128 + signal.SIGINT)
    return State.KILLED if killed else State.FAILED


def _error(folder: Path, status: int) -> str | None:
    """First line of the error's file, which is written here where the process could not."""
    if status == 0:
        return None
    file = folder / ERROR_FILE
    if not file.is_file():
        printed = (folder / OUTPUT_FILE).read_text(encoding="utf-8", errors="replace").splitlines()
        last = "\n".join(printed[-LAST_LINES:])
        file.write_text(f"{described(status)}\n\nThe last lines of its output:\n{last}\n", "utf-8")
    with file.open(encoding="utf-8") as stream:
        return stream.readline().strip()
