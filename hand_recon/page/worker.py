"""A process that does the server's work, with a deadline, and that is replaced when it fails."""

import asyncio
import contextlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final, Protocol, runtime_checkable

from omegaconf import DictConfig, OmegaConf

START: Final = 120.0
"""Time that a new process may take to load the networks, seconds."""


class BusyError(RuntimeError):
    """More files wait than may wait."""


class TookTooLongError(RuntimeError):
    """A piece of work did not end in time, and its process was ended."""


class WorkerEndedError(RuntimeError):
    """The process that worked on a file ended, such as for lack of memory."""


@runtime_checkable
class Worker(Protocol):
    """Calls methods of `HandService` by name."""

    async def call(self, method: str, *arguments: Any, **named: Any) -> Any:  # noqa: ANN401
        """Call a method.

        Args:
            method: Name of the method.
            *arguments: Its arguments.
            **named: Its arguments by name.
        """
        ...

    async def close(self) -> None:
        """End it."""
        ...


_service: Any = None
"""The service of this process, or the reason why there is none."""


def _load(content: Any) -> None:  # noqa: ANN401  # the configuration as plain values
    """Load the networks in a new process, which the command's Ctrl-C does not end."""
    global _service  # one service in each process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # In the new process alone: the server itself needs no torch.
    from hand_recon.data.processes import end_with_parent
    from hand_recon.page.hand_service import HandService

    end_with_parent()
    try:
        _service = HandService(OmegaConf.create(content))
    except Exception as error:  # noqa: BLE001  # raised by the first call, where the server can tell it
        _service = error


def _call(method: str, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> Any:  # noqa: ANN401
    if isinstance(_service, Exception):
        raise _service
    return getattr(_service, method)(*arguments, **named)


class WorkerProcess:
    """One process for all work, one piece after the other.

    Args:
        config: `conf/demo.yaml` composed.
        seconds: Time for one piece of work.
        waiting: Pieces that may wait while another is worked on.
        load: Prepares a new process.
        perform: Does a piece of work in it.
    """

    def __init__(
        self,
        config: DictConfig,
        *,
        seconds: float,
        waiting: int,
        load: Callable[[Any], None] = _load,
        perform: Callable[..., Any] = _call,
    ) -> None:
        content = OmegaConf.to_container(config, resolve=False)
        self.content: Any = content
        self.seconds, self.waiting = seconds, waiting
        self.load, self.perform = load, perform
        self.pool: ProcessPoolExecutor | None = None
        self.process: int | None = None
        self.lock = asyncio.Lock()
        self.pieces = 0

    async def call(self, method: str, *arguments: Any, **named: Any) -> Any:  # noqa: ANN401
        """Call a method in the process; as `Worker.call`.

        Raises:
            BusyError: Too many pieces wait.
            TookTooLongError: The method did not return in time.
            WorkerEndedError: The process ended.
            Exception: What the method raises.
        """
        if self.pieces > self.waiting:
            raise BusyError(
                f"{self.pieces} files are being worked on or wait, and more are not taken. Try again in "
                "a few seconds."
            )
        self.pieces += 1
        try:
            async with self.lock:
                return await self._perform(method, arguments, named)
        finally:
            self.pieces -= 1

    async def _perform(
        self, method: str, arguments: tuple[Any, ...], named: Mapping[str, Any]
    ) -> Any:  # noqa: ANN401
        try:
            pool = await self._started()
            work = asyncio.wrap_future(pool.submit(self.perform, method, arguments, named))
            return await asyncio.wait_for(work, self.seconds)
        except TimeoutError as error:
            self._end()
            raise TookTooLongError(
                f"This took longer than {self.seconds:g} seconds and was ended; expected less. Give a "
                "smaller file, or start the page with a larger bounds.seconds."
            ) from error
        except asyncio.CancelledError:
            # Whoever asked is gone, and the piece of work cannot be called back.
            self._end()
            raise
        except BrokenProcessPool as error:
            self._end()
            raise WorkerEndedError(
                "The process that worked on this file ended, perhaps for lack of memory; expected it to give "
                "a result. Another one is started: give a smaller file."
            ) from error

    async def _started(self) -> ProcessPoolExecutor:
        """The process, started anew if it was ended."""
        if self.pool is None:
            self.pool = ProcessPoolExecutor(
                1,
                multiprocessing.get_context("spawn"),
                initializer=self.load,
                initargs=(self.content,),
            )
            started = asyncio.wrap_future(self.pool.submit(os.getpid))
            self.process = await asyncio.wait_for(started, START)
        return self.pool

    def _end(self) -> None:
        """End the process, whatever it does."""
        pool, process, self.pool, self.process = self.pool, self.process, None, None
        if process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)

    async def close(self) -> None:
        """End the process."""
        self._end()
