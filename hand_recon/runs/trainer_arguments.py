"""Arguments of Lightning's trainer that depend on the processes of a run (decision 94)."""

import os
from typing import Any

from lightning.fabric.plugins.environments.cluster_environment import ClusterEnvironment
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from omegaconf import DictConfig

from hand_recon.command_line.launched import Place


def trainer_arguments(trainer: DictConfig, place: Place) -> dict[str, Any]:
    """Strategy, plugins and samplers of a trainer.

    Args:
        trainer: The group `trainer` of a configuration.
        place: Of this process.
    """
    # The datamodules deal out samples themselves.
    arguments: dict[str, Any] = {"use_distributed_sampler": False}
    if place.count == 1:
        # Lightning would take one process of a SLURM job for one of the job's tasks.
        return arguments | {"strategy": "auto", "plugins": [LightningEnvironment()]}
    chosen = trainer.get("strategy", "auto")
    return arguments | {
        "strategy": "ddp" if chosen == "auto" else chosen, "plugins": [Together(place)],
    }  # fmt: skip


class Together(ClusterEnvironment):
    """Lightning's view of processes that are there already, and have formed their group.

    Args:
        place: Of this process.
    """

    def __init__(self, place: Place) -> None:
        super().__init__()
        self.place = place

    @property
    def creates_processes_externally(self) -> bool:
        """True: Lightning starts none."""
        return True

    @property
    def main_address(self) -> str:
        """Address of the first process, for a group that exists."""
        return os.environ.get("MASTER_ADDR", "127.0.0.1")

    @property
    def main_port(self) -> int:
        """Port of the first process, for a group that exists."""
        return int(os.environ.get("MASTER_PORT", "0"))

    @staticmethod
    def detect() -> bool:
        """False: it is given, not found."""
        return False

    def world_size(self) -> int:
        """Number of all processes."""
        return self.place.count

    def set_world_size(self, size: int) -> None:
        """Leave the number as it is."""

    def global_rank(self) -> int:
        """Number of this process among all."""
        return self.place.rank

    def set_global_rank(self, rank: int) -> None:
        """Leave the number as it is."""

    def local_rank(self) -> int:
        """Number of this process among those of its machine."""
        return self.place.local_rank

    def node_rank(self) -> int:
        """Number of this machine."""
        return self.place.rank // self.place.local_count
