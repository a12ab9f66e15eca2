"""Trainings of a lifter in several processes, as torchrun starts them, on one machine."""

import os
import socket
import sys
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import lightning

from tests.support.killed_training import Death, context, train_killed

WITHOUT_DRAWS = ("model.encoder.landmark_dropout=0",)
"""Nothing is hidden at random, so that the number of processes changes no number."""

UNEVEN = ("synthetic.val=11", "synthetic.test=11", "trainer.max_epochs=2", *WITHOUT_DRAWS)
"""Two epochs. Eleven hands are shared evenly by neither two nor three processes."""


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
