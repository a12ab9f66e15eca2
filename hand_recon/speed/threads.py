"""Networks on one and on two threads, and on a machine that is busy with other work.

Wall-clock time counts here, since that is what threads save. Threads of OpenMP spin while they wait for each
other unless they are told to sleep, and are told when torch is loaded: so both ways have a process each.
"""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Final

import torch
from torch import Tensor

from hand_recon.command_line.processor import usable_cores
from hand_recon.formats.onnx_graphs import NetworkGraph
from hand_recon.speed.measurement import Settings, Work, interleaved, ratios, spread
from hand_recon.speed.rows import LeftOut, Row, hands

THREADS: Final = 2
"""Threads that are compared with one."""
BUSY: Final = "while True: pass"
"""Program that keeps one core busy."""
WORKER: Final = """
import sys
import torch
from hand_recon.hand.open_hand import open_hand
from hand_recon.runs.lifters import DEFAULT
from hand_recon.runs.onnx_run import load_graph

torch.set_num_threads(int(sys.argv[1]))
graph = load_graph(DEFAULT, open_hand())[0]
values = graph.example(int(sys.argv[2]))
print("ready", flush=True)
for line in sys.stdin:
    with torch.no_grad():
        graph(*values)
    print("done", flush=True)
"""
"""Program that runs the packaged lifter once for each line it is given; arguments: threads and hands."""


def measure_threads(
    name: str, graph: NetworkGraph, batches: Sequence[int], settings: Settings
) -> Iterator[Row | LeftOut]:
    """Time a network in PyTorch on one thread and on two.

    Args:
        name: The network, in a few words.
        graph: The network.
        batches: Numbers of hands.
        settings: Time for each comparison.
    """
    if usable_cores() < THREADS:
        yield LeftOut("inference", f"{name}, {THREADS} threads", "there is one core")
        return
    for batch in batches:
        values = graph.example(batch)
        works: dict[str, Work] = {
            str(count): partial(_with_threads, count, graph, values) for count in (1, THREADS)
        }
        try:
            times = interleaved(works, replace(settings, threads=THREADS))
        finally:
            torch.set_num_threads(settings.threads)
        yield Row(
            suite="inference",
            work=f"{name}, PyTorch, {THREADS} threads",
            size=hands(batch),
            items=batch,
            seconds=spread(times[str(THREADS)]),
            reference="one thread",
            reference_seconds=spread(times["1"]),
            ratio=ratios(times["1"], times[str(THREADS)]),
            note="wall-clock time",
        )


def measure_busy(batches: Sequence[int], settings: Settings) -> Iterator[Row | LeftOut]:
    """Time the packaged lifter beside a program that takes a core, by how its threads wait.

    Args:
        batches: Numbers of hands.
        settings: Time for each comparison.
    """
    if usable_cores() < THREADS:
        yield LeftOut("inference", "packaged lifter beside other work", "there is one core")
        return
    for batch in batches:
        with ExitStack() as stack:
            works: dict[str, Work] = {
                "one": stack.enter_context(worker(1, batch, "PASSIVE")),
                "sleeping": stack.enter_context(worker(THREADS, batch, "PASSIVE")),
                "spinning": stack.enter_context(worker(THREADS, batch, None)),
            }
            stack.enter_context(busy_core())
            times = interleaved(works, replace(settings, threads=THREADS))
        for work, label in (("one", "1 thread"), ("sleeping", f"{THREADS} threads that sleep")):
            yield Row(
                suite="inference",
                work=f"packaged lifter beside a busy process, {label}",
                size=hands(batch),
                items=batch,
                seconds=spread(times[work]),
                reference=f"{THREADS} threads that spin",
                reference_seconds=spread(times["spinning"]),
                ratio=ratios(times["spinning"], times[work]),
                note="wall-clock time",
            )


@torch.no_grad()
def _with_threads(count: int, graph: NetworkGraph, values: Sequence[Tensor]) -> None:
    torch.set_num_threads(count)
    graph(*values)


@contextmanager
def worker(threads: int, batch: int, waiting: str | None) -> Iterator[Work]:
    """Process that runs the packaged lifter, as a function that runs it once and returns when it is done.

    Args:
        threads: Threads of torch.
        batch: Number of hands.
        waiting: OpenMP's waiting policy; None for OpenMP's own.

    Raises:
        RuntimeError: The process ended.
    """
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    if waiting is not None:
        environment["OMP_WAIT_POLICY"] = waiting
    command = [sys.executable, "-c", WORKER, str(threads), str(batch)]
    with subprocess.Popen(  # noqa: S603  # our own words
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:

        def run_once() -> None:
            _say(process, "go\n")
            _expect(process, "done")

        _expect(process, "ready")
        yield run_once
        _say(process, "")


def _say(process: "subprocess.Popen[str]", words: str) -> None:
    """Write words to a worker; none closes its input, which ends it."""
    assert process.stdin is not None  # noqa: S101  # it is a pipe
    if not words:
        # A process that has ended leaves words that it has not read.
        with suppress(BrokenPipeError):
            process.stdin.close()
        return
    process.stdin.write(words)
    process.stdin.flush()


def _expect(process: "subprocess.Popen[str]", word: str) -> None:
    """Wait for a worker's answer."""
    assert process.stdout is not None  # noqa: S101  # it is a pipe
    answer = process.stdout.readline().strip()
    if answer != word:
        raise RuntimeError(
            f"A process with the packaged lifter answered {answer!r}; expected {word!r}. Its error is above."
        )


@contextmanager
def busy_core() -> Iterator[None]:
    """Keep one core busy meanwhile."""
    with subprocess.Popen([sys.executable, "-c", BUSY]) as process:  # noqa: S603  # our own words
        try:
            yield
        finally:
            process.kill()
