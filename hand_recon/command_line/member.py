"""One run of a sweep as a process of its own, on the cores that it was given.

python -m hand_recon.command_line.member '{"verb": "train", "config_name": "train", "overrides": ["seed=1"]}'

Launchers of sweeps start it. The exit status is that of the verb; the error goes to the
file that `error` names.
"""

import json
import os
import sys
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

from hand_recon.command_line.hydra_verb import run_overrides
from hand_recon.command_line.processor import share_processor


@dataclass(frozen=True)
class Call:
    """A verb with its overrides."""

    verb: str
    """A key of `VERBS`."""
    config_name: str
    """File of `conf`."""
    overrides: tuple[str, ...]
    """Overrides in Hydra's grammar."""
    cores: tuple[int, ...] = ()
    """Cores that the process runs on; none for all that it may use."""
    error: str | None = None
    """File for the error."""

    def words(self) -> list[str]:
        """Command line of the process."""
        return [sys.executable, "-m", "hand_recon.command_line.member", json.dumps(asdict(self))]

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `words` wrote."""
        content = json.loads(text)
        for name in ("overrides", "cores"):
            content[name] = tuple(content[name])
        return cls(**content)


def main(text: str) -> None:
    """Run the call.

    Args:
        text: The call as JSON.

    Raises:
        SystemExit: With the verb's status.
    """
    call = Call.from_json(text)
    take_cores(call.cores)
    try:
        run_overrides(call.verb, call.config_name, call.overrides)
    except BaseException as end:
        interrupted = isinstance(end, KeyboardInterrupt)
        status = end.code if isinstance(end, SystemExit) else 1
        cause = end.__cause__ or end.__context__ if isinstance(end, SystemExit) else end
        if status and call.error is not None and cause is not None and not interrupted:
            _write(cause, Path(call.error))
        raise


def take_cores(cores: tuple[int, ...]) -> None:
    """Keep this process, and those that it starts, to some cores, all of which its threads use.

    Args:
        cores: Numbers of cores; none for those that other processes leave free.
    """
    if not cores:
        share_processor()
        return
    # Without the counters of `share_processor`, every core that a process may use is taken for free.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def _write(error: BaseException, file: Path) -> None:
    """Write an error's message in the first line, and its traceback below."""
    message = " ".join(str(error).split()) or type(error).__name__
    lines = traceback.format_exception(error)
    file.write_text(f"{type(error).__name__}: {message}\n\n{''.join(lines)}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
