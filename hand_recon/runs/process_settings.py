"""Number of processes that a trainer's settings ask for, and settings that cannot work (decision 94)."""

from typing import Any, Final

import torch
from omegaconf import DictConfig, ListConfig

from hand_recon.command_line.launched import Place

STRATEGIES: Final = (
    "auto", "ddp", "ddp_find_unused_parameters_false", "ddp_find_unused_parameters_true",
)  # fmt: skip
"""Values of `trainer.strategy`: data-parallel training in processes of equal weights."""


def uses_gpus(trainer: DictConfig) -> bool:
    """True if a trainer computes on GPUs of CUDA."""
    accelerator = trainer.get("accelerator", "auto")
    if accelerator == "auto":
        return torch.cuda.is_available()
    return accelerator in ("gpu", "cuda")


def expected_processes(trainer: DictConfig) -> int:
    """Processes that a trainer's settings ask for, one for each device of each machine."""
    return processes_of_a_machine(trainer) * int(trainer.get("num_nodes", 1))


def processes_of_a_machine(trainer: DictConfig) -> int:
    """Number of `trainer.devices`, a number, a list of GPUs or `auto`: all GPUs, or one processor."""
    devices: Any = trainer.get("devices", 1)
    if isinstance(devices, list | ListConfig):
        return len(devices)
    text = str(devices)
    if text in ("auto", "-1"):
        return max(torch.cuda.device_count(), 1) if uses_gpus(trainer) else 1
    return len([part for part in text.split(",") if part]) if "," in text else int(text)


def check_together(trainer: DictConfig, launched: Place) -> None:
    """Check a trainer's settings against the launcher and the machine.

    Args:
        trainer: The group `trainer` of a configuration.
        launched: Place that a launcher gave this process.

    Raises:
        ValueError: They cannot work; the message says what can.
    """
    _check_numbers(trainer)
    machines, expected = int(trainer.get("num_nodes", 1)), expected_processes(trainer)
    asked = f"trainer.devices={trainer.get('devices', 1)} trainer.num_nodes={machines}"
    if max(launched.count, 1) != expected and launched.launcher is not None:
        raise ValueError(
            f"{launched.launcher} started {launched.count} processes, and {asked} are {expected}. Give "
            "trainer.devices the processes of each machine and trainer.num_nodes the machines, or start the "
            f"command without {launched.launcher}."
        )
    if launched.launcher is None and machines > 1:
        raise ValueError(
            f"{asked}: processes on several machines are started there by torchrun or srun, which was not "
            "used. docs/many_processes.md has a command for each; on one machine give trainer.num_nodes=1."
        )
    if trainer.get("strategy", "auto") not in STRATEGIES:
        raise ValueError(
            f"trainer.strategy={trainer.strategy} is not supported; expected one of {', '.join(STRATEGIES)}. "
            "Others start processes without the run's folder, or write checkpoints in parts."
        )
    if expected > 1:
        _check_devices(trainer)


def _check_numbers(trainer: DictConfig) -> None:
    """Check that there is a process at all.

    Raises:
        ValueError: There is not, or a setting is no number.
    """
    for key in ("devices", "num_nodes"):
        value = trainer.get(key, 1)
        try:
            count = processes_of_a_machine(trainer) if key == "devices" else int(value)
        except (TypeError, ValueError):
            count = 0
        if count < 1:
            also = ", a list of GPUs, or auto or -1 for all GPUs" if key == "devices" else ""
            raise ValueError(
                f"Found trainer.{key}={value}; expected 1 or more{also}. Give trainer.{key}=1 for one."
            )


def _check_devices(trainer: DictConfig) -> None:
    """Check that several processes have a device each.

    Raises:
        ValueError: They have not.
    """
    if uses_gpus(trainer):
        there = torch.cuda.device_count()
        if processes_of_a_machine(trainer) > there:
            raise ValueError(
                f"trainer.devices={trainer.devices} asks for more GPUs than the {there} of this machine. "
                "Lower trainer.devices, or train on processors with trainer.accelerator=cpu."
            )
        return
    if trainer.get("accelerator", "auto") not in ("auto", "cpu"):
        raise ValueError(
            f"trainer.accelerator={trainer.accelerator} has one device. Give trainer.devices=1, or "
            "trainer.accelerator=gpu or cpu."
        )
    if trainer.get("sync_batchnorm", False):
        raise ValueError(
            "trainer.sync_batchnorm=true needs GPUs, since torch has no SyncBatchNorm for processors. Leave "
            "it false: each process then normalizes its own batch, or use model=lifter, which has no "
            "batch normalization."
        )
