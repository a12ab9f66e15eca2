"""Processes beside the first one of a training or an evaluation, which starts and watches them.

They end with the first process however it ends, and if one of them fails the first process ends, too.
"""

import importlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, NoReturn

from omegaconf import DictConfig, OmegaConf

from hand_recon.command_line.launched import LAUNCHER, OURS, error_prefix
from hand_recon.runs.configuration import plain

TERMINATED: Final = 143
"""Exit status of a process that SIGTERM ended."""

GRACE: Final = 15.0
"""Seconds that a process has to end by itself once another one has failed."""

_POLL: Final = 0.2


class OtherProcesses:
    """All processes but the first.

    Args:
        config: Of the command, resolved for them.
        task: Function that they call with it, as `module:function`.
        count: Number of all processes, the first included.
        port: Port of this machine where the first process waits for them.
    """

    def __init__(self, config: DictConfig, task: str, count: int, port: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="hand_recon_processes_")
        self._file = Path(self._folder.name) / "config.yaml"
        OmegaConf.save(OmegaConf.create(plain(config)), self._file)
        self._task, self._count, self._port = task, count, port
        self._ended = threading.Event()
        self._killed: set[int] = set()
        self.children: dict[int, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "OtherProcesses":
        for rank in range(1, self._count):
            place = {
                "RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": self._count,
                "LOCAL_WORLD_SIZE": self._count, "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": self._port,
                LAUNCHER: OURS,
            }  # fmt: skip
            self.children[rank] = subprocess.Popen(  # noqa: S603  # this program itself
                [sys.executable, "-m", __name__, str(self._file), self._task],
                env=os.environ | {name: str(value) for name, value in place.items()},
                # Its end tells them of the end of this process, be it a kill.
                stdin=subprocess.PIPE,
                # Ctrl-C is for this process alone.
                start_new_session=True,
            )
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        # After SIGTERM, and where another process has the error, they end by themselves.
        self._wait(GRACE if isinstance(error, SystemExit) else None if error is None else 0.0)
        self.kill()
        for child in self.children.values():
            if child.stdin is not None:
                child.stdin.close()
        self._folder.cleanup()
        if error is None:
            self.raise_if_failed()

    def raise_if_failed(self, seconds: float = 0.0) -> None:
        """Check whether a process failed.

        Args:
            seconds: Longest wait for the end of one.

        Raises:
            ChildProcessError: One did.
        """
        end = time.monotonic() + seconds
        while (failed := self.failed()) is None and time.monotonic() < end:
            time.sleep(_POLL)
        if failed is not None:
            status = self.children[failed].returncode
            raise ChildProcessError(
                f"Process {failed} of {self._count} ended with status {status}; its message is above."
            )

    def kill(self) -> None:
        """Kill those that have not ended."""
        for child in self.children.values():
            if child.poll() is None:
                child.kill()
                self._killed.add(child.pid)
            child.wait()

    def failed(self) -> int | None:
        """Number of a process that ended with an error by itself; None if there is none."""
        for rank, child in self.children.items():
            if child.poll() not in (None, 0, TERMINATED) and child.pid not in self._killed:
                return rank
        return None

    def terminate(self) -> None:
        """Send SIGTERM to all."""
        for child in self.children.values():
            if child.poll() is None:
                child.terminate()

    def _wait(self, seconds: float | None) -> None:
        """Wait until all have ended, at most some seconds."""
        end = None if seconds is None else time.monotonic() + seconds
        while any(child.poll() is None for child in self.children.values()):
            if self.failed() is not None and end is None:
                end = time.monotonic() + GRACE
            if end is not None and time.monotonic() > end:
                return
            time.sleep(_POLL)

    def _watch(self) -> None:
        """End this process some time after another one did, if it waits for that one for ever."""
        while not self._ended.wait(_POLL):
            ended = [rank for rank, child in self.children.items() if child.poll()]
            if not ended or self._ended.wait(GRACE):
                continue
            status = self.children[ended[0]].returncode
            sys.stderr.write(
                f"error: process {ended[0]} of {self._count} ended with status {status}, and this one waited "
                "for it.\n"
            )
            self.terminate()
            os._exit(TERMINATED if status == TERMINATED else 1)


def main(words: Sequence[str] | None = None) -> None:
    """Run a command's function in a process beside the first one.

    Args:
        words: The file of the configuration, and the function; none for this process's own.

    Raises:
        SystemExit: It failed; status 1.
    """
    file, task = sys.argv[1:] if words is None else words
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    module, _, name = task.partition(":")
    try:
        getattr(importlib.import_module(module), name)(OmegaConf.load(file))
    except Exception as error:
        if "HYDRA_FULL_ERROR" in os.environ:
            raise
        sys.stderr.write(f"{error_prefix()}: {type(error).__name__}: {error}\n")
        raise SystemExit(1) from error


def _end_with_the_first() -> NoReturn:
    """Wait until the first process is gone, and end this one."""
    # Not through sys.stdin, whose lock would be held at the end of the program.
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
