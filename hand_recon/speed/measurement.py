"""Time and memory of works, measured in turn so that other programs disturb all of them alike."""

import multiprocessing
import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import torch

from hand_recon.speed.rows import Spread

Work = Callable[[], object]
"""Function that does the work once."""

WARM_UP: Final = 3
"""Runs that are not counted: they allocate memory and fill caches."""
LEAST_ROUNDS: Final = WARM_UP + 5
"""Rounds even of works that take longer than the time for them, up to eight times that."""

_STATUS: Final = Path("/proc/self/status")
_RESET: Final = Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Settings:
    """Threads, device and time of a benchmark."""

    threads: int = 1
    """Threads of torch and of the libraries below it."""
    device: str = "cpu"
    """Device of torch."""
    seconds: float = 5.0
    """Time for each comparison; more time means more runs."""
    quick: bool = False
    """True leaves out what takes minutes."""
    cache: str = "outputs/cache"
    """Folder of rendered hands and other caches."""
    checkpoint: str | None = None
    """Run or checkpoint of an image network, for the suites that need one."""

    @property
    def processor_time(self) -> bool:
        """True if processor time is measured, which other programs disturb less than wall-clock time."""
        return self.device == "cpu" and self.threads == 1


def interleaved(works: Mapping[str, Work], settings: Settings) -> dict[str, list[float]]:
    """Run works in turn until their time is over: seconds of every run, by work.

    Args:
        works: The works; each is run once before the others are run again.
        settings: Clock, device and time.
    """
    clock = time.process_time if settings.processor_time else time.perf_counter
    taken: dict[str, list[float]] = {name: [] for name in works}
    begun, rounds = time.perf_counter(), 0
    while rounds < LEAST_ROUNDS or time.perf_counter() - begun < settings.seconds:
        for name, work in works.items():
            began = clock()
            work()
            _finish(settings.device)
            taken[name].append(clock() - began)
        rounds += 1
        if rounds > WARM_UP and time.perf_counter() - begun > 8 * max(settings.seconds, 1.0):
            break
    return {name: times[WARM_UP:] for name, times in taken.items()}


def _finish(device: str) -> None:
    """Wait for the work of a device."""
    if device != "cpu":
        torch.accelerator.synchronize()


def spread(values: Sequence[float]) -> Spread:
    """Median and quartiles of measurements."""
    if len(values) < 2:
        return Spread(values[0], values[0], values[0])
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return Spread(middle, low, high)


def ratios(reference: Sequence[float], work: Sequence[float]) -> Spread:
    """Spread of the ratio of two works, in pairs of runs that followed each other."""
    return spread([one / other for one, other in zip(reference, work, strict=True)])


def peak_memory(make: Callable[[], Work], threads: int) -> float:
    """Growth of memory at its peak while a work runs in a process of its own, MB.

    Args:
        make: Function that makes the work; it can be pickled. What it holds is not counted.
        threads: Threads of torch.

    Raises:
        RuntimeError: The process ended without an answer.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_grow, args=(make, threads, sender))
    process.start()
    sender.close()
    try:
        grown = float(receiver.recv())
    except EOFError:
        raise RuntimeError(
            f"The process that measures memory ended with status {process.exitcode}; expected a number."
        ) from None
    finally:
        process.join()
    return grown


def _grow(make: Callable[[], Work], threads: int, answer: Connection) -> None:
    torch.set_num_threads(threads)
    work = make()
    before = _peak(reset=True)
    work()
    answer.send(_peak() - before)


def _peak(*, reset: bool = False) -> float:
    """Most memory that this process has had, MB; with `reset`, what it has now, from where it counts again.

    Systems without Linux's files cannot count again: what comes after a higher peak is not seen there.
    """
    if _STATUS.exists() and _RESET.exists():
        if reset:
            _RESET.write_text("5", encoding="ascii")
        lines = _STATUS.read_text(encoding="ascii").splitlines()
        return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    # macOS counts bytes, other systems kilobytes.
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
