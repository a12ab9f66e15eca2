"""Launchers of hand_recon's sweeps: runs as processes of this machine, or as jobs of SLURM.

Hydra imports this module when any of its programs starts, so that nothing large is imported at its top.
"""

import sys
from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn, JobStatus, configure_log, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict, read_write

OF_THE_SWEEP = (
    "hydra.mode", "hydra.sweep", "hydra.run.dir", "hydra/launcher", "hydra.launcher", "hydra/sweeper",
    "hydra.sweeper",
)  # fmt: skip
"""Beginnings of Hydra's own overrides that runs of a sweep do not get."""


class MemberLauncher(Launcher):
    """Runs each member of a sweep as a process of its own, and tells in a table how each has ended."""

    config: DictConfig
    hydra_context: HydraContext

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """Take Hydra's parts; the verb's function is found again by each process."""
        del task_function
        self.hydra_context, self.config = hydra_context, config

    def launch(
        self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int
    ) -> Sequence[JobReturn]:
        """Run the members; failed ones are noted in `failed_members`."""
        from hand_recon.command_line.hydra_verb import failed_members
        from hand_recon.sweeps.launching import launch, show

        setup_globals()
        configure_log(self.config.hydra.hydra_logging, self.config.hydra.verbose)
        common = set.intersection(*(set(overrides) for overrides in job_overrides))
        members = [
            self._member(list(overrides), number, common)
            for number, overrides in enumerate(job_overrides, start=initial_job_idx)
        ]
        ended = launch(members, self.run)
        show(ended)
        failed_members.extend(one.name for one in ended if not one.good)
        return [
            # Hydra would stop at the first failed one.
            JobReturn(overrides=overrides, _return_value=one, status=JobStatus.COMPLETED)
            for overrides, one in zip(job_overrides, ended, strict=True)
        ]

    @abstractmethod
    def run(self, members: Sequence[Any]) -> list[Any]:
        """Run members to their ends."""

    def _member(self, overrides: list[str], number: int, common: set[str]) -> Any:  # noqa: ANN401  # imported below
        """A member with its folder and settings, composed as its process will compose it."""
        from hand_recon.command_line.resolvers import register_resolvers
        from hand_recon.runs.unfinished_runs import training_settings
        from hand_recon.sweeps.attempts import Member

        register_resolvers()
        composed = self.hydra_context.config_loader.load_sweep_config(self.config, overrides)
        with read_write(composed), read_write(composed.hydra.runtime), open_dict(composed):
            composed.hydra.job.id = composed.hydra.job.num = number
            HydraConfig.instance().set_config(composed)
            folder = Path(composed.hydra.sweep.dir) / composed.hydra.sweep.subdir
            composed.hydra.runtime.output_dir = str(folder.absolute())
            HydraConfig.instance().set_config(composed)
            job = composed.hydra.job
            del composed["hydra"]
        own = [
            word
            for word in self.config.hydra.overrides.hydra
            if not word.lstrip("+~").startswith(OF_THE_SWEEP)
        ]
        verb = sys.argv[0].split()[-1]
        name = " ".join([str(number), *(word for word in overrides if word not in common)])
        settings = training_settings(composed)
        return Member(verb, job.config_name, (*own, *overrides), folder, settings, name)


class ProcessLauncher(MemberLauncher):
    """Runs members as processes of this machine, some at once, each on cores and a GPU of its own.

    Args:
        n_jobs: Runs at once; none for one per GPU, or one alone without GPUs; -1 for one per core.
    """

    def __init__(self, n_jobs: int | None = None) -> None:
        super().__init__()
        self.n_jobs = n_jobs

    def run(self, members: Sequence[Any]) -> list[Any]:
        """Run members to their ends."""
        from hand_recon.command_line.processor import core_numbers
        from hand_recon.sweeps.launching import run_locally
        from hand_recon.sweeps.places import places, visible_gpus

        return run_locally(members, places(self.n_jobs, core_numbers(), visible_gpus()))


class SubmititLauncher(MemberLauncher):
    """Runs members as jobs of SLURM.

    Args:
        cluster: `slurm`, or `local` for processes of this machine in the same way.
        submitit_folder: Folder for submitit's files, in that of the sweep.
        parameters: Parameters of submitit's executor, such as `timeout_min` and `slurm_partition`.
    """

    def __init__(self, cluster: str, submitit_folder: str, **parameters: Any) -> None:  # noqa: ANN401
        super().__init__()
        self.cluster, self.folder = cluster, submitit_folder
        self.parameters = {name: value for name, value in parameters.items() if value is not None}

    def run(self, members: Sequence[Any]) -> list[Any]:
        """Run members to their ends."""
        from hand_recon.sweeps.launching import run_by_submitit

        folder = str(Path(self.config.hydra.sweep.dir) / self.folder)
        return run_by_submitit(members, self.cluster, folder, self.parameters)
