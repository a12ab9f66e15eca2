"""Forms the group of processes of a training or an evaluation, and shares the first one's work (decision 94).

The first process has the run's folder and writes everything; the others are quiet but for their errors.
"""

import logging
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import timedelta
from typing import Any, Final, TypeVar

import torch
import torch.distributed as dist
from lightning.fabric.plugins.environments.slurm import SLURMEnvironment
from omegaconf import DictConfig, OmegaConf
from torch.distributed import TCPStore  # type: ignore[attr-defined]  # Its stubs lack the name.

from hand_recon.command_line.launched import OURS, Place, launched_place
from hand_recon.processes import process_group
from hand_recon.runs.configuration import plain
from hand_recon.runs.other_processes import TERMINATED, OtherProcesses
from hand_recon.runs.process_settings import check_together, processes_of_a_machine

Result = TypeVar("Result")

_THREADS: Final = "OMP_NUM_THREADS"

_NOTICED: Final = 5.0
"""Seconds in which a process that has failed is gone."""


def place_of(config: DictConfig) -> Place:
    """Place of this process, after a check that the trainer's settings can work.

    Args:
        config: Of a training or an evaluation.

    Raises:
        ValueError: They cannot; the message has the remedy.
    """
    launched = launched_place()
    check_together(config.trainer, launched)
    if launched.launcher is not None:
        return launched
    local = processes_of_a_machine(config.trainer)
    return replace(launched, count=local, local_count=local)


@contextmanager
def joined(place: Place, config: DictConfig, task: str, threads: int) -> Iterator[None]:
    """In the block, all processes work together; the first starts the others if no launcher did.

    Args:
        place: Of this process.
        config: Of the command; the other processes get it.
        task: Function that they call with it, as `module:function`.
        threads: Compute threads of each.

    Raises:
        ChildProcessError: Another process ended with an error.
    """
    if place.count == 1:
        yield
        return
    wait = timedelta(minutes=float(config.wait_minutes))
    with ExitStack() as stack:
        stack.enter_context(_threads_kept())
        others = store = None
        if place.rank:
            _be_quiet()
        if place.launcher is None:
            theirs = OmegaConf.create(plain(config) | {"threads": threads})
            store = TCPStore("127.0.0.1", 0, place.count, True, wait, False)
            others = stack.enter_context(OtherProcesses(theirs, task, place.count, store.port))
        _form_group(place, wait, store)
        stack.callback(leave)
        with _ended_with_this(others):
            yield


@contextmanager
def _ended_with_this(others: OtherProcesses | None) -> Iterator[None]:
    """End the other processes with an error of this one, and tell it from the error of one of them."""
    if others is None:
        yield
        return
    try:
        yield
    except SystemExit as end:
        if end.code == TERMINATED:
            others.terminate()
        raise
    except RuntimeError as error:
        # An exchange with a process that has failed is an error here, too.
        try:
            others.raise_if_failed(_NOTICED)
        except ChildProcessError as theirs:
            raise theirs from error
        others.kill()
        raise
    except BaseException:
        others.kill()
        raise


def leave() -> None:
    """Leave the group: from here on, this process works alone."""
    if process_group.count() > 1:
        dist.destroy_process_group()


def from_first(place: Place, function: Callable[[], Result]) -> Result:
    """Call a function in the first process; all get its result.

    If it fails, the first process has the error, and the others end quietly with status 1.

    Args:
        place: Of this process.
        function: Returns something that can be pickled.
    """
    results: list[Any] = _all_succeed(lambda: function() if place.rank == 0 else None)
    first: Result = results[0]
    return first


def first_of_each_machine(place: Place, function: Callable[[], Result]) -> Result:
    """Call a function in one process of each machine, and then in the others, which find its files.

    If it fails in one process, that one has the error, and the others end quietly with status 1.

    Args:
        place: Of this process.
        function: Such as one that renders images into a cache.
    """
    results: list[Result] = []
    for first in (True, False):
        if (place.local_rank == 0) == first:
            _all_succeed(lambda: results.append(function()))
        else:
            _all_succeed(lambda: None)
    return results[0]


def _all_succeed(function: Callable[[], Result]) -> list[Result]:
    """Results of all processes; the others end if one of them fails."""
    try:
        value = function()
    except BaseException:
        process_group.gathered((False, None), patient=True)
        raise
    everyone: list[Any] = process_group.gathered((True, value), patient=True)
    if not all(succeeded for succeeded, _ in everyone):
        raise SystemExit(1)
    results = [result for _, result in everyone]
    # Its own is the object itself, not a copy.
    results[process_group.rank()] = value
    return results


def _form_group(place: Place, wait: timedelta, store: TCPStore | None) -> None:
    """Form torch's process group: gloo between processors, NCCL between GPUs."""
    if place.launcher == OURS:
        address, port = os.environ["MASTER_ADDR"], int(os.environ["MASTER_PORT"])
        store = TCPStore(address, port, place.count, False, wait)
    if place.launcher == "srun":
        environment = SLURMEnvironment(auto_requeue=False)
        os.environ["MASTER_ADDR"] = environment.main_address
        os.environ["MASTER_PORT"] = str(environment.main_port)
    backend = "cpu:gloo,cuda:nccl" if torch.cuda.is_available() else "gloo"
    dist.init_process_group(
        backend, store=store, rank=place.rank, world_size=place.count, timeout=wait
    )


@contextmanager
def _threads_kept() -> Iterator[None]:
    """Keep Lightning from choosing a number of threads, which it does where the environment has none."""
    before = os.environ.get(_THREADS)
    os.environ.setdefault(_THREADS, str(torch.get_num_threads()))
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_THREADS, None)


def _be_quiet() -> None:
    """Leave messages and warnings, which are those of the first process, to it."""
    logging.disable(logging.WARNING)
    warnings.simplefilter("ignore")
