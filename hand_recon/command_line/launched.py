"""Processes of a command that a launcher starts together, as the environment tells (torchrun, srun)."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Place:
    """Place of this process among those that work together."""

    rank: int = 0
    """Number among all processes, from 0."""
    local_rank: int = 0
    """Number among those of this machine."""
    count: int = 1
    """All processes."""
    local_count: int = 1
    """Processes of this machine."""
    launcher: str | None = None
    """The launcher that started all of them; none for a process that was started by itself."""


LAUNCHER: Final = "HAND_RECON_LAUNCHER"
"""Variable with the launcher's name, of processes that another process of the command started."""

OURS: Final = "hand-recon"
"""That name."""

ALONE: Final = Place()
"""A process by itself."""


def launched_place(environment: Mapping[str, str] | None = None) -> Place:
    """The place that a launcher gave this process: torchrun's variables, or those of a step of SLURM's srun.

    Args:
        environment: Variables; none for the process's own.
    """
    env = os.environ if environment is None else environment
    if "RANK" in env and "WORLD_SIZE" in env:
        count = int(env["WORLD_SIZE"])
        local = int(env.get("LOCAL_WORLD_SIZE", count))
        launcher = env.get(LAUNCHER, "torchrun")
        return Place(int(env["RANK"]), int(env.get("LOCAL_RANK", 0)), count, local, launcher)
    # Without a step, the variables are those of a batch script, which is one process. In the step of one task
    # in which salloc starts a shell, SLURM_NTASKS is the job's number; the step has its own.
    count = int(env.get("SLURM_STEP_NUM_TASKS", 1)) if "SLURM_STEP_ID" in env else 1
    if count > 1:
        machines = int(env.get("SLURM_STEP_NUM_NODES", env.get("SLURM_NNODES", 1)))
        local = int(env.get("SLURM_NTASKS_PER_NODE", count // machines))
        return Place(
            int(env["SLURM_PROCID"]), int(env["SLURM_LOCALID"]), count, max(local, 1), "srun"
        )
    return ALONE


def error_prefix() -> str:
    """Beginning of an error message: which process has it, unless it is the first."""
    rank = launched_place().rank
    return f"error in process {rank}" if rank else "error"
