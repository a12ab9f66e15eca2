"""The process of the page's work: deadlines, crashes, and a queue of a bounded length."""

import asyncio
import os
from collections.abc import Awaitable, Callable

import pytest
from omegaconf import OmegaConf

from hand_recon.page.worker import BusyError, TookTooLongError, WorkerEndedError, WorkerProcess
from tests.support.page_process import load, perform


def run(
    steps: Callable[[WorkerProcess], Awaitable[None]], *, seconds: float = 20.0, waiting: int = 1
) -> None:
    """Run some steps with a process, which is ended afterwards."""

    async def main() -> None:
        config = OmegaConf.create({"number": 7})
        worker = WorkerProcess(config, seconds=seconds, waiting=waiting, load=load, perform=perform)
        try:
            await steps(worker)
        finally:
            await worker.close()

    asyncio.run(main())


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


async def ended(process: int) -> bool:
    """True once a process has ended, false if it lives for seconds."""
    for _ in range(100):
        if not is_alive(process):
            return True
        await asyncio.sleep(0.05)
    return False


def test_work_is_done_in_one_process_with_the_configuration() -> None:
    async def steps(worker: WorkerProcess) -> None:
        first, given, arguments, named = await worker.call("sum", 1, "a", key=2)
        assert first != os.getpid()
        assert (given, arguments, named) == ("7", (1, "a"), {"key": 2})
        with pytest.raises(ValueError, match=r"^The file is damaged\.$"):
            await worker.call("fail")
        assert (await worker.call("sum"))[0] == first
        await worker.close()
        assert await ended(first)

    run(steps)


def test_work_that_takes_too_long_is_ended_and_another_process_goes_on() -> None:
    async def steps(worker: WorkerProcess) -> None:
        first = (await worker.call("sum"))[0]
        with pytest.raises(TookTooLongError, match=r"longer than 1\.5 seconds and was ended"):
            await worker.call("sleep", 60)
        assert await ended(first)
        assert (await worker.call("sum"))[0] != first

    run(steps, seconds=1.5)


def test_a_process_that_ends_is_replaced() -> None:
    async def steps(worker: WorkerProcess) -> None:
        with pytest.raises(WorkerEndedError, match=r"ended, perhaps for lack of memory"):
            await worker.call("crash")
        assert (await worker.call("sum"))[1] == "7"

    run(steps)


def test_more_work_than_may_wait_is_refused_at_once_and_the_rest_is_done() -> None:
    async def steps(worker: WorkerProcess) -> None:
        await worker.call("sum")
        pieces = [asyncio.create_task(worker.call("sleep", 0.3)) for _ in range(2)]
        await asyncio.sleep(0)
        with pytest.raises(BusyError, match=r"2 files are being worked on or wait.*Try again"):
            await worker.call("sum")
        processes = {(await piece)[0] for piece in pieces}
        assert processes == {(await worker.call("sum"))[0]}

    run(steps, waiting=1)
