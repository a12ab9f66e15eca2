"""A training of one process has nothing to do with a cluster that it happens to run on."""

import lightning
import pytest
from omegaconf import OmegaConf

from hand_recon.command_line.launched import Place
from hand_recon.runs.trainer_arguments import trainer_arguments


def test_one_process_in_a_job_of_several_tasks_trains_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As in a job of `sbatch -n 8` that does not use srun, which Lightning by itself refuses.
    monkeypatch.setenv("SLURM_NTASKS", "8")
    monkeypatch.setenv("SLURM_JOB_NAME", "training")
    with pytest.raises(RuntimeError, match="ntasks"):
        lightning.Trainer(accelerator="cpu", devices=1, logger=False)
    arguments = trainer_arguments(OmegaConf.create({}), Place())
    trainer = lightning.Trainer(accelerator="cpu", devices=1, logger=False, **arguments)
    assert trainer.world_size == 1
