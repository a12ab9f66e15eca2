"""Places of processes by the variables of torchrun and of SLURM."""

import pytest

from hand_recon.command_line.hydra_verb import OF_OTHER_PROCESSES, of_other_processes
from hand_recon.command_line.launched import ALONE, Place, error_prefix, launched_place
from hand_recon.command_line.words import UsageError

TORCHRUN = {"RANK": "3", "LOCAL_RANK": "1", "WORLD_SIZE": "4", "LOCAL_WORLD_SIZE": "2"}
SRUN = {
    "SLURM_STEP_ID": "0", "SLURM_STEP_NUM_TASKS": "8", "SLURM_STEP_NUM_NODES": "2", "SLURM_NTASKS": "8",
    "SLURM_PROCID": "5", "SLURM_LOCALID": "1", "SLURM_NTASKS_PER_NODE": "4", "SLURM_NNODES": "2",
}  # fmt: skip


@pytest.mark.parametrize(
    ("environment", "place"),
    [
        ({}, ALONE),
        (TORCHRUN, Place(3, 1, 4, 2, "torchrun")),
        (TORCHRUN | {"HAND_RECON_LAUNCHER": "hand-recon"}, Place(3, 1, 4, 2, "hand-recon")),
        (SRUN, Place(5, 1, 8, 4, "srun")),
        # Eight tasks on two machines, of which only the number was given.
        ({k: v for k, v in SRUN.items() if "PER_NODE" not in k}, Place(5, 1, 8, 4, "srun")),
        # Two tasks on one machine, as a step of a job that has two machines.
        (
            {k: v for k, v in SRUN.items() if "PER_NODE" not in k}
            | {"SLURM_STEP_NUM_TASKS": "2", "SLURM_STEP_NUM_NODES": "1", "SLURM_PROCID": "1"},
            Place(1, 1, 2, 2, "srun"),
        ),
        # A batch script itself, and a step of one task.
        ({k: v for k, v in SRUN.items() if k != "SLURM_STEP_ID"}, ALONE),
        (SRUN | {"SLURM_NTASKS": "1", "SLURM_STEP_NUM_TASKS": "1", "SLURM_PROCID": "0"}, ALONE),
        # The shell of salloc, a step of one task: the number of tasks is the job's.
        (SRUN | {"SLURM_STEP_ID": "4294967290", "SLURM_STEP_NUM_TASKS": "1"}, ALONE),
        # torchrun started by srun.
        (SRUN | TORCHRUN, Place(3, 1, 4, 2, "torchrun")),
    ],
)
def test_the_place_is_that_of_the_launchers_variables(
    environment: dict[str, str], place: Place
) -> None:
    assert launched_place(environment) == place


def test_other_processes_have_no_folder_and_sign_their_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert of_other_processes(["seed=1"]) == ()
    assert error_prefix() == "error"
    for name, value in TORCHRUN.items():
        monkeypatch.setenv(name, value)
    assert of_other_processes(["seed=1"]) == OF_OTHER_PROCESSES
    assert error_prefix() == "error in process 3"
    with pytest.raises(UsageError, match=r"torchrun started 4 processes of a sweep.*Start it"):
        of_other_processes(["-m", "seed=1,2"])
