"""Shares a processor with other programs: waiting threads sleep, and busy cores are left to others."""

import gc
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_COUNTERS: Final = Path("/proc/stat")
_IDLE: Final = (3, 4)
"""Fields of the first line of `/proc/stat`, after its name, that count idle time: idle and iowait."""


@dataclass(frozen=True)
class BusyTime:
    """Processor time of the whole machine and of this process up to one moment."""

    wall: float
    """Seconds of a clock that never goes back."""
    machine: float
    """Seconds that all cores together were busy."""
    own: float
    """Seconds of processor time that this process and its finished children took."""
    cores: int
    """Cores of the machine."""


def busy_time() -> BusyTime | None:
    """Read the counters of the machine and of this process; None where the system has no `/proc/stat`."""
    try:
        lines = _COUNTERS.read_text(encoding="ascii").splitlines()
        ticks = [int(field) for field in lines[0].split()[1:9]]
        per_second = os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError):
        return None
    busy = sum(value for field, value in enumerate(ticks) if field not in _IDLE) / per_second
    cores = sum(line.startswith("cpu") for line in lines) - 1
    return BusyTime(time.monotonic(), busy, sum(os.times()[:4]), max(cores, 1))


def free_cores(usable: int, before: BusyTime | None, now: BusyTime | None) -> int:
    """Cores that other processes leave to this one, at least 1.

    Args:
        usable: Cores that this process may use.
        before: Counters at the start of the command.
        now: Counters now, a second or more later; with less between them, or without counters, all usable
            cores are taken for free.
    """
    if before is None or now is None or now.wall - before.wall < 1:
        return usable
    others = (now.machine - before.machine) - (now.own - before.own)
    share = others / ((now.wall - before.wall) * now.cores)
    return max(1, usable - round(usable * min(max(share, 0.0), 1.0)))


_start: list[BusyTime | None] = []


def share_processor() -> None:
    """Let idle threads sleep, unless the environment says otherwise; call it before torch is loaded.

    By default OpenMP's threads spin while they wait for each other. On a busy machine that steals the
    time of the thread they wait for: two torch threads were 5 to 8 times slower (decision 52).
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    _start[:] = [busy_time()]


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause the search for unreachable objects, which takes a sixth of a command's start and finds none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def core_numbers() -> list[int]:
    """Numbers of the cores that this process may use."""
    # Systems without CPU affinity give a process all cores.
    return sorted(getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))(0))


def usable_cores() -> int:
    """Number of the cores that this process may use."""
    return len(core_numbers())


def processor_name() -> str:
    """Name of the processor's model; of its architecture where the system does not tell."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def default_threads() -> int:
    """Threads of a command that was given no number: the cores that are not busy with other processes.

    Without `share_processor`, every core that this process may use.
    """
    return free_cores(usable_cores(), _start[0] if _start else None, busy_time())
