"""Trainings of a lifter in several processes, as torchrun starts them, on one machine."""

import json
import os
import socket
import sys
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import lightning
import torch

from tests.support.killed_training import Death, context, state, train_killed

WITHOUT_DRAWS = ("model.encoder.landmark_dropout=0",)
"""Nothing is hidden at random, so that the number of processes changes no number."""

UNEVEN = (
    "synthetic.val=11", "synthetic.test=11", "trainer.max_epochs=2", "optimizer.schedule=null",
    *WITHOUT_DRAWS,
)  # fmt: skip
"""Two epochs at the full learning rate; eleven hands are shared evenly by neither two nor three processes."""


class Fault(lightning.Callback):
    """An error of one process at a step.

    Args:
        step: Optimizer steps before it.
        rank: The process.
    """

    def __init__(self, step: int, rank: int) -> None:
        super().__init__()
        self.step, self.rank = step, rank

    def on_train_batch_start(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Raise it."""
        if (trainer.global_step, trainer.global_rank) == (self.step, self.rank):
            raise ValueError("The image of this process is damaged.")


class FirstGradient(lightning.Callback):
    """Write the gradient of the first step, before it is clipped, into the run's folder."""

    def on_before_optimizer_step(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        optimizer: torch.optim.Optimizer,
    ) -> None:
        """Write it."""
        if trainer.global_step == 0 and trainer.is_global_zero:
            parts = [one.grad.flatten() for one in pl_module.parameters() if one.grad is not None]
            torch.save(torch.cat(parts), Path(trainer.default_root_dir) / GRADIENT)


GRADIENT = "first_gradient.pt"
"""Its file."""

WITH_GRADIENT = f"+callbacks.gradient._target_={FirstGradient.__module__}.FirstGradient"
"""Setting that writes it."""


def gradient_difference(one: Path, other: Path) -> float:
    """Length of the difference of two runs' first gradients, over the length of the first run's."""
    first, second = (torch.load(run / GRADIENT, weights_only=True) for run in (one, other))
    return float((first - second).norm() / first.norm())


def scores(folder: Path) -> dict[str, float]:
    """All scores of a run: of the test hands, of the constant hand, and the factor of σ."""
    metrics = json.loads((folder / "metrics.json").read_text())
    constant = {f"mean pose {name}": value for name, value in metrics["mean_pose"].items()}
    factor = float(state(folder)["hand_recon_sigma_factor"])
    return {**metrics["test"], **constant, "factor of σ": factor}


def messages_of(folder: Path) -> Path:
    """File of the messages and errors of a process, beside its folder."""
    return folder.parent / f"messages of {folder.name}.txt"


def start_together(
    cache: Path,
    folder: Path,
    count: int,
    *overrides: str,
    death: Death | None = None,
    dying: int = 0,
) -> list[ForkServerProcess]:
    """Begin a training in some processes.

    Args:
        cache: Cache of the synthetic hands.
        folder: `paths.run` of the first process; the others have another one in their configuration, as
            when their second is another.
        count: Number of processes.
        overrides: Further settings.
        death: The signal that one of them sends itself; none trains to the end.
        dying: Number of that one.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    processes = []
    for rank in range(count):
        place = {
            "RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": count, "LOCAL_WORLD_SIZE": count,
            "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port,
        }  # fmt: skip
        own = folder if rank == 0 else folder.with_name(f"{folder.name}_of_{rank}")
        words = (f"trainer.devices={count}", *overrides)
        mine = death if rank == dying else None
        own.parent.mkdir(parents=True, exist_ok=True)
        process = context().Process(target=_train, args=(place, cache, own, words, mine))
        process.start()
        processes.append(process)
    return processes


def _train(
    place: dict[str, int | str],
    cache: Path,
    folder: Path,
    overrides: tuple[str, ...],
    death: Death | None,
) -> None:
    os.environ.update({name: str(value) for name, value in place.items()})
    # Messages of processes that a server of forks starts cannot be captured otherwise.
    messages = os.open(messages_of(folder), os.O_WRONLY | os.O_CREAT)
    os.dup2(messages, 2)
    sys.stderr = os.fdopen(2, "w", closefd=False)
    train_killed(cache, folder, overrides, death)
