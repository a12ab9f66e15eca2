"""Trainings of a lifter in processes of their own that are killed at a step, and what they leave."""

import contextlib
import io
import logging
import multiprocessing
import os
import signal
from dataclasses import dataclass
from multiprocessing.context import ForkServerContext, ForkServerProcess
from pathlib import Path
from typing import Any, Final

import lightning
import torch

from hand_recon.runs.training_run import train
from tests.support.configurations import settings

LIFTER: Final = (
    "recipe=lifter", "synthetic.train=80", "synthetic.val=8", "synthetic.test=8",
    "data.render_workers=1", "data.batch_size=16", "model.width=32", "model.encoder.width=32",
    "model.encoder.depth=1", "trainer.max_epochs=4", "trainer.check_val_every_n_epoch=2",
    "trainer.accelerator=cpu", "report.images=0", "threads=1", "checkpoint.every_n_steps=3",
    "checkpoint.every_minutes=null",
)  # fmt: skip
"""Four epochs of five steps on one thread, with hidden landmarks, dropout and a switch to the likelihood."""

STEPS: Final = 20
"""Steps of such a training."""


class Kill(lightning.Callback):
    """Send this process a signal when a step begins."""

    def __init__(self, step: int, number: int) -> None:
        super().__init__()
        self.step = step
        self.number = number

    def on_train_batch_start(
        self,
        trainer: lightning.Trainer,
        pl_module: lightning.LightningModule,
        batch: Any,  # noqa: ANN401
        batch_idx: int,
    ) -> None:
        """Send it."""
        if trainer.global_step == self.step:
            os.kill(os.getpid(), self.number)


@dataclass(frozen=True)
class Death:
    """End of a training before its end."""

    step: int
    """Step at whose beginning the signal comes."""
    number: int
    """The signal."""


def context() -> ForkServerContext:
    """Starts processes from one that has imported everything, which takes most of a short training's time."""
    made = multiprocessing.get_context("forkserver")
    made.set_forkserver_preload(["tests.support.killed_training"])
    return made


def start(
    cache: Path, folder: Path, *overrides: str, death: Death | None = None
) -> ForkServerProcess:
    """Begin a training in a process of its own.

    Args:
        cache: Cache of the synthetic hands.
        folder: `paths.run`; `paths.output` is the folder two above it.
        overrides: Further settings.
        death: The signal that it sends itself; none trains to the end.
    """
    process = context().Process(target=train_killed, args=(cache, folder, overrides, death))
    process.start()
    return process


def status(process: ForkServerProcess) -> int:
    """Exit status of a training, awaited; minus the signal that ended it."""
    process.join(timeout=300)
    code = process.exitcode
    assert code is not None, "The training has not ended within 300 s."
    return code


def train_killed(
    cache: Path, folder: Path, overrides: tuple[str, ...], death: Death | None
) -> None:
    """Train in this process; see `start`."""
    logging.disable(logging.WARNING)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # Loading processes as a command starts them: those of a server of forks would outlive a kill.
    multiprocessing.set_start_method("fork", force=True)
    more: tuple[str, ...] = ()
    if death is not None:
        target = f"{Kill.__module__}.Kill"
        more = (
            f"+callbacks.kill._target_={target}", f"+callbacks.kill.step={death.step}",
            f"+callbacks.kill.number={int(death.number)}",
        )  # fmt: skip
    config = settings(cache, folder, *LIFTER, *overrides, *more)
    config.paths.output = str(folder.parent.parent)
    # The table of scores is for people.
    with contextlib.redirect_stdout(io.StringIO()):
        train(config)


def logged(folder: Path) -> str:
    """Text of a run's table of losses, learning rates and scores."""
    return (folder / "csv" / "metrics.csv").read_text()


def state(folder: Path) -> dict[str, Any]:
    """A run's last checkpoint."""
    return dict(torch.load(folder / "checkpoints" / "last.ckpt", weights_only=True))


def differences(one: object, other: object, name: str = "") -> list[str]:
    """Names of the entries in which two checkpoints differ, bit for bit.

    Args:
        one: A checkpoint, or an entry.
        other: The other one.
        name: Of the entry.
    """
    if isinstance(one, dict) and isinstance(other, dict):
        keys = one.keys() | other.keys()
        pairs = [(f"{name}/{key}", one.get(key), other.get(key)) for key in sorted(keys, key=str)]
    elif (
        isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other)
    ):
        pairs = [(f"{name}/{i}", *pair) for i, pair in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, torch.Tensor) and isinstance(other, torch.Tensor):
        return [] if torch.equal(one, other) else [name]
    else:
        return [] if one == other else [name]
    return [found for key, a, b in pairs for found in differences(a, b, key)]


OWN: Final = (
    "/hand_recon_config/paths", "/hand_recon_config/callbacks", "/hand_recon_config/resume",
    "/hand_recon_config/logger", "/hand_recon_config/trainer/default_root_dir",
    "/callbacks/ModelCheckpoint",
)  # fmt: skip
"""Entries of a checkpoint that name folders or the signal; the score of the best one is compared apart."""


def other_entries(one: Path, other: Path) -> list[str]:
    """Entries that differ between the last checkpoints of two runs, but for those that name folders.

    Args:
        one: A run's folder.
        other: The other one's.
    """
    first, second = state(one), state(other)
    found = [name for name in differences(first, second) if not name.startswith(OWN)]
    return found + differences(_best_scores(first), _best_scores(second), "best_model_score")


def _best_scores(checkpoint: dict[str, Any]) -> list[Any]:
    states = checkpoint["callbacks"].items()
    return [value["best_model_score"] for name, value in states if name.startswith("ModelCh")]
