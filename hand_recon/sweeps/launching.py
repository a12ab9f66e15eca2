"""Launches the runs of a sweep, skips finished ones, and tells at the end how each has ended."""

import importlib
import logging
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from hand_recon.runs.last_checkpoint import TERMINATED
from hand_recon.sweeps.attempts import Member, attempt_in_use, finished_attempt
from hand_recon.sweeps.member_process import Ended, end_all, run_member
from hand_recon.sweeps.places import Place
from hand_recon.tables.member_record import State

logger = logging.getLogger(__name__)

OF_THE_EXECUTOR: Final = ("slurm_max_num_timeout",)
"""Parameters that submitit takes when it begins, not for a job."""

Runner = Callable[[Sequence[Member]], list[Ended]]
"""Runs members to their ends, in any order at once; their ends in the order of the members."""


def launch(members: Sequence[Member], runner: Runner) -> list[Ended]:
    """Run the members of a sweep that are not finished.

    Args:
        members: All runs of the sweep.
        runner: Runs those that are to be run.

    Returns:
        The end of each, in their order.
    """
    known = {member.name: ended for member in members if (ended := _not_to_run(member))}
    for ended in known.values():
        logger.info("%s: %s (%s)", ended.name, ended.state, ended.folder)
    waiting = [member for member in members if member.name not in known]
    ran = {ended.name: ended for ended in runner(waiting)} if waiting else {}
    return [(known | ran)[member.name] for member in members]


def _not_to_run(member: Member) -> Ended | None:
    if (folder := finished_attempt(member)) is not None:
        return Ended(member.name, "skipped", folder, told="finished before")
    if (folder := attempt_in_use(member)) is not None:
        return Ended(member.name, "in use", folder, told="another process goes on with it")
    return None


def run_locally(members: Sequence[Member], free: Sequence[Place]) -> list[Ended]:
    """Run members at once, one at each place, by joblib.

    Args:
        members: The runs.
        free: The places.
    """
    places: queue.SimpleQueue[Place] = queue.SimpleQueue()
    for place in free:
        places.put(place)

    def run(member: Member) -> Ended:
        place = places.get()
        try:
            return _told(member, place)
        finally:
            places.put(place)

    with ended_by_sigterm():
        if len(free) == 1:
            return [run(member) for member in members]
        joblib = _optional("joblib", "train")
        # Threads, since each run is a process already.
        parallel = joblib.Parallel(n_jobs=len(free), backend="threading", batch_size=1)
        return list(parallel(joblib.delayed(run)(member) for member in members))


def _told(member: Member, place: Place) -> Ended:
    where = f"cores {place.cores}" if place.cores else "all cores"
    gpu = "" if place.gpu is None else f", GPU {place.gpu}"
    logger.info("%s begins (%s%s): %s", member.name, where, gpu, member.folder)
    try:
        ended = run_member(member, place)
    except OSError as error:
        # Such as a full disk, or no more processes; other members may go on.
        ended = Ended(member.name, State.FAILED, member.folder, told=str(error))
    logger.info("%s %s after %.0f s. %s", ended.name, ended.state, ended.seconds or 0, ended.told)
    return ended


def run_by_submitit(
    members: Sequence[Member], cluster: str, folder: str, parameters: dict[str, Any]
) -> list[Ended]:
    """Run members as jobs of SLURM, by submitit, and wait for all of them.

    Args:
        members: The runs.
        cluster: `slurm`, or `local` for processes of this machine.
        folder: Folder for submitit's files.
        parameters: For submitit, such as `timeout_min` and `slurm_partition`.
    """
    submitit = _optional("submitit", "sweeps")
    from hand_recon.sweeps.job import MemberJob

    # Restarts after a time limit are a matter of the executor; the rest goes to each job.
    own = {key: parameters[key] for key in OF_THE_EXECUTOR if key in parameters}
    executor = submitit.AutoExecutor(folder=folder, cluster=cluster, **own)
    executor.update_parameters(**{key: parameters[key] for key in parameters if key not in own})
    with executor.batch():
        jobs = [executor.submit(MemberJob(member)) for member in members]
    for member, job in zip(members, jobs, strict=True):
        logger.info("%s is job %s", member.name, job.job_id)
    return [_result(member, job) for member, job in zip(members, jobs, strict=True)]


def _result(member: Member, job: Any) -> Ended:  # noqa: ANN401  # submitit's
    try:
        ended: Ended = job.result()
    # A job that was cancelled, or whose node was lost, has no result.
    except Exception as error:  # noqa: BLE001
        reason = (str(error).strip().splitlines() or [type(error).__name__])[-1]
        ended = Ended(member.name, State.KILLED, member.folder, told=f"job {job.job_id}: {reason}")
    logger.info("%s %s. %s", ended.name, ended.state, ended.told)
    return ended


def table(ended: Sequence[Ended]) -> Table:
    """The ends of all runs of a sweep."""
    counts = {
        state: sum(one.state == state for one in ended)
        for state in dict.fromkeys(one.state for one in ended)
    }
    shown = Table(title=", ".join(f"{count} {state}" for state, count in counts.items()))
    for column in ("run", "state", "seconds", "note"):
        shown.add_column(column, justify="right" if column == "seconds" else "left")
    for one in ended:
        seconds = "" if one.seconds is None else f"{one.seconds:.0f}"
        shown.add_row(one.name, one.state, seconds, one.told)
    return shown


def show(ended: Sequence[Ended]) -> None:
    """Print the table."""
    Console().print(table(ended))


def _optional(name: str, extra: str) -> Any:  # noqa: ANN401  # a module
    """Import a package of an extra.

    Raises:
        ModuleNotFoundError: It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"This sweep needs {name}, which is not installed. Install the extra: pip install "
            f"'hand_recon[{extra}]'."
        ) from error


@contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """In the block, SIGTERM is passed on to the running members; at its end this process ends with 143."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        came.set()
        end_all()

    before = signal.signal(signal.SIGTERM, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
        if came.is_set():
            raise SystemExit(TERMINATED)
