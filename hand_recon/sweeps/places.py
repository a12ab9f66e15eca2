"""Places for runs that go on at once: a group of cores each, and a GPU where there are any."""

import os
import shutil
import subprocess
from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Hardware of one run."""

    cores: tuple[int, ...] = ()
    """Numbers of its cores; none for all."""
    gpu: str | None = None
    """Its GPUs as CUDA_VISIBLE_DEVICES names them; none where the machine has none."""

    def environment(self) -> dict[str, str]:
        """Variables of the environment of a process there."""
        if self.gpu is None:
            return dict(os.environ)
        return os.environ | {"CUDA_VISIBLE_DEVICES": self.gpu}


def places(at_once: int | None, cores: list[int], gpus: list[str]) -> list[Place]:
    """Divide a machine among runs.

    Args:
        at_once: Runs at once; none for one per GPU, or one alone without GPUs; -1 for one per core.
        cores: Numbers of the cores.
        gpus: Names of the GPUs; with more runs than GPUs, several share one, with fewer, each has several.

    Raises:
        ValueError: `at_once` is no such number.
    """
    count = {None: max(1, len(gpus)), -1: len(cores)}.get(at_once, at_once)
    if count is None or count < 1:
        raise ValueError(
            f"hydra.launcher.n_jobs={at_once}; expected a number of runs at once from 1, -1 for one per "
            "core, or null for one per GPU."
        )
    groups = [tuple(cores[i::count]) or (cores[i % len(cores)],) for i in range(count)]
    return [
        Place(group if count > 1 else (), _gpus_of(i, count, gpus))
        for i, group in enumerate(groups)
    ]


def _gpus_of(run: int, count: int, gpus: list[str]) -> str | None:
    """GPUs of one of several runs, as CUDA_VISIBLE_DEVICES names them."""
    if not gpus:
        return None
    return ",".join(gpus[run::count] or [gpus[run % len(gpus)]])


def visible_gpus() -> list[str]:
    """GPUs that this process may use: those of CUDA_VISIBLE_DEVICES, else all that nvidia-smi lists."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [name.strip() for name in named.split(",") if name.strip() not in ("", "-1")]
    program = shutil.which("nvidia-smi")
    if program is None:
        return []
    command = [program, "--query-gpu=index", "--format=csv,noheader"]
    listed = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  # no input of users
    return listed.stdout.split() if listed.returncode == 0 else []
