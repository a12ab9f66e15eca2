"""Trains a model, tests its best checkpoint and writes the results (Sec. 3.4, 4)."""

import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import lightning
from lightning.pytorch.callbacks import ModelCheckpoint
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from hand_recon import __version__
from hand_recon.command_line.launched import ALONE, Place
from hand_recon.data.datamodule import HandDataModule
from hand_recon.evaluation.scores import HandPoints
from hand_recon.processes.process_group import gathered
from hand_recon.regressor.compiling import compile_backbones
from hand_recon.runs.building import build_data, build_module, check_input
from hand_recon.runs.checkpoint_writer import WholeCheckpoints
from hand_recon.runs.checkpoints import ConfigInCheckpoint, load_trained
from hand_recon.runs.configuration import (
    check_extra,
    claim_folder,
    configure_process,
    instantiate,
    plain,
)
from hand_recon.runs.last_checkpoint import sigterm_ends_the_process
from hand_recon.runs.offending_batch import save_batch
from hand_recon.runs.results import Run, finish_run, mean_pose
from hand_recon.runs.resuming import Earlier, adopt, earlier_run, repeat_metrics
from hand_recon.runs.sigma_calibration import SigmaInCheckpoint
from hand_recon.runs.trainer_arguments import trainer_arguments
from hand_recon.runs.training_progress import is_interactive, progress_callback, quiet_libraries
from hand_recon.runs.unfinished import finish, mark_unfinished
from hand_recon.runs.unfinished_runs import training_settings
from hand_recon.runs.working_together import (
    first_of_each_machine,
    from_first,
    joined,
    place_of,
)
from hand_recon.training.epoch_losses import EpochLosses
from hand_recon.training.module import HandReconstruction
from hand_recon.training.non_finite import NonFiniteLossError
from hand_recon.training.seeded_steps import SeededSteps

logger = logging.getLogger(__name__)

TASK: Final = f"{__name__}:train"
"""This command's function, for its other processes."""


def train(config: DictConfig) -> dict[str, Any]:
    """Train, test the best checkpoint, and write metrics, images and a report.

    Args:
        config: `conf/train.yaml` composed, with `paths.run` a folder without a run in it.

    Returns:
        What `metrics.json` holds.

    Raises:
        SystemExit: SIGTERM ended the training; status 143.
    """
    check_extra("tensorboard", "matplotlib", "jinja2")
    with sigterm_ends_the_process():
        place = place_of(config)
        lightning.seed_everything(config.seed, workers=True, verbose=False)
        quiet_libraries()
        threads = configure_process(config.threads, place.local_count)
        with joined(place, config, TASK, threads):
            return _train(config, place, threads)


def _train(config: DictConfig, place: Place, threads: int) -> dict[str, Any]:
    start = from_first(place, partial(_begin, config))
    # The folder of another process, which a launcher started, would have the name of another second.
    config.paths.run = str(start.folder)
    data, module = first_of_each_machine(place, partial(_built, config))
    parameters = sum(parameter.numel() for parameter in module.parameters())
    logger.info("%s: %.1f M parameters, %d threads", config.name, parameters / 1e6, threads)
    logger.info("If it is interrupted, the same command with resume=%s goes on.", start.folder)
    if place.count > 1:
        logger.info(
            "%d processes with batches of %d: %d hands in a step. The learning rate is that of the "
            "configuration.", place.count, data.batch_size, place.count * data.batch_size,
        )  # fmt: skip
    # Photographs are decoded before the time is taken. Rendered hands are awaited batch by batch, if need be.
    first_of_each_machine(place, partial(data.setup, "fit"))
    mean = cache(partial(mean_pose, data))
    trainer = build_trainer(config, mean, place)
    if config.compile:
        compile_backbones(module, str(trainer.strategy.root_device))
    seconds = _fit(trainer, module, data, start, place)
    best = best_checkpoint(trainer)
    steps = trainer.fit_loop.total_batch_idx + 1 - start.batches
    hands = steps * place.count * data.batch_size
    facts = {
        "checkpoint": str(best.relative_to(os.path.realpath(start.folder))),
        "parameters": parameters,
        "processes": place.count,
        "hands_per_step": place.count * data.batch_size,
        "train_seconds": round(seconds, 1),
        "train_images_per_second": round(hands / max(seconds, 1e-9), 1),
        "epochs": trainer.current_epoch,
    }
    trained = load_trained(best, composed=config).module
    metrics = finish_run(Run(config, start.folder, trained, data, mean(), facts, place=place))
    if place.rank == 0:
        finish(start.folder)
    return metrics


@dataclass(frozen=True)
class Start:
    """Beginning of a run, which the first process makes."""

    folder: Path
    """The run's."""
    earlier: Earlier | None = None
    """The run that is continued, in the first process."""
    batches: int = 0
    """Batches that each process made before."""

    def __getstate__(self) -> dict[str, Any]:
        """All but the contents of a checkpoint, for other processes."""
        return vars(self) | {"earlier": None}


def _begin(config: DictConfig) -> Start:
    """Find the run to continue, and make the folder of this one, marked as unfinished."""
    earlier = earlier_run(config)
    folder = claim_folder(config.paths.run)
    mark_unfinished(folder, {"training": training_settings(config), "version": __version__})
    OmegaConf.save(OmegaConf.create(plain(config)), folder / "config.yaml")
    if earlier is None:
        return Start(folder)
    return Start(folder, earlier, earlier.batches)


def _built(config: DictConfig) -> tuple[HandDataModule, HandReconstruction]:
    """Data and module, which fit each other."""
    data, module = build_data(config), build_module(config)
    check_input(module, data)
    return data, module


def _fit(
    trainer: lightning.Trainer,
    module: HandReconstruction,
    data: HandDataModule,
    start: Start,
    place: Place,
) -> float:
    """Train, from the checkpoint of an earlier run if there is one; the seconds that it took.

    Raises:
        FloatingPointError: A loss is not finite; its batch is in the run's folder.
    """

    def take_over() -> Path | None:
        if start.earlier is None:
            return None
        repeat_metrics(start.earlier, trainer.loggers)
        return adopt(start.earlier, start.folder)

    last = from_first(place, take_over)
    started = time.monotonic()
    try:
        trainer.fit(module, datamodule=data, ckpt_path=last, weights_only=True)
    except NonFiniteLossError as error:
        # The first of the processes that have such a loss writes its batch.
        if gathered(error.own).index(True) != place.rank:
            raise SystemExit(1) from error
        file = save_batch(error, start.folder)
        raise FloatingPointError(f"{error} The batch is in {file} (torch.load).") from error
    except SystemExit as error:
        # Lightning ends a process with 1 after Ctrl-C; the command's own status and message follow.
        if trainer.interrupted and error.code == 1:
            raise KeyboardInterrupt from error
        raise
    return time.monotonic() - started


def best_checkpoint(trainer: lightning.Trainer) -> Path:
    """The best checkpoint of a run and of those that it continues.

    Args:
        trainer: After training.

    Raises:
        ValueError: Nothing was trained.
    """
    savers = (one for one in trainer.callbacks if isinstance(one, ModelCheckpoint))  # type: ignore[attr-defined]
    path = Path(next((one.best_model_path for one in savers), "") or "absent")
    if not path.is_file():
        raise ValueError(
            f"Nothing was trained and validated in {trainer.max_epochs} epochs: give trainer.max_epochs=1 or "
            "more."
        )
    return path


def build_trainer(
    config: DictConfig, mean: Callable[[], HandPoints | None], place: Place = ALONE
) -> lightning.Trainer:
    """The Lightning trainer of a run.

    Args:
        config: Of the run.
        mean: Gives the mean training hand, for the checkpoints; called when the first is saved.
        place: Of this process.
    """
    arguments = trainer_arguments(config.trainer, place)
    callbacks = [instantiate(callback) for callback in config.callbacks.values()]
    loggers = [instantiate(one) for one in config.logger.values()]

    def points() -> dict[str, Tensor]:
        hand = mean()
        if hand is None:
            return {}
        surface = {} if hand.vertices is None else {"vertices": hand.vertices}
        return {"landmarks": hand.landmarks} | surface

    trainer: lightning.Trainer = instantiate(
        config.trainer,
        callbacks=[
            *callbacks,
            ConfigInCheckpoint(plain(config), points),
            SigmaInCheckpoint(),
            SeededSteps(config.seed),
            EpochLosses(),
            progress_callback(),
        ],
        logger=loggers,
        enable_progress_bar=is_interactive(),
        **arguments | {"plugins": [WholeCheckpoints(), *arguments["plugins"]]},
    )
    return trainer
